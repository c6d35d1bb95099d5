//! What tests of memory share.

/// The largest resident set of this process so far, in bytes.
pub(crate) fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).expect("the mark");
    let kibibytes = line.split_whitespace().nth(1).and_then(|n| n.parse::<u64>().ok());
    kibibytes.expect("a number") * 1024
}
