//! What this program is, and what machine it runs on.

/// The version of the program.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The parts that the program was built with.
pub(crate) fn features() -> Vec<&'static str> {
    let all = [("render", cfg!(feature = "render")), ("gpu", cfg!(feature = "gpu"))];
    all.into_iter().filter_map(|(name, is_there)| is_there.then_some(name)).collect()
}

/// The processor's name, where the system tells it.
pub(crate) fn processor() -> String {
    named_processor().unwrap_or_else(|| "unknown".to_owned())
}

#[cfg(target_os = "linux")]
fn named_processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

#[cfg(target_os = "macos")]
fn named_processor() -> Option<String> {
    let mut sysctl = std::process::Command::new("sysctl");
    let output = sysctl.args(["-n", "machdep.cpu.brand_string"]).output().ok()?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned()).filter(|name| !name.is_empty())
}

#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn named_processor() -> Option<String> {
    std::env::var("PROCESSOR_IDENTIFIER").ok()
}

/// The widest vector instructions in use.
#[cfg(feature = "render")]
pub(crate) fn instructions() -> &'static str {
    nst_render::instruction_set()
}

#[cfg(not(feature = "render"))]
pub(crate) fn instructions() -> &'static str {
    "no renderer"
}

/// The adapters that networks can run on.
#[cfg(feature = "gpu")]
pub(crate) fn adapters() -> Vec<String> {
    nst_core::gpu::adapters()
}

#[cfg(not(feature = "gpu"))]
pub(crate) fn adapters() -> Vec<String> {
    Vec::new()
}
