//! The library of `fake.c`, compiled as a test wants it, and what it logs.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use nst_oidn::{Device, Error, Library};

/// A fake library in a folder of its own, which is deleted in the end.
pub(crate) struct Fake {
    folder: tempfile::TempDir,
    path: PathBuf,
}

impl Fake {
    /// The library with these macros, as in `FAIL="oidnNewBuffer"`. Where Rust can link
    /// programs, there is a C compiler: it is the linker.
    pub(crate) fn new(macros: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let name = if cfg!(target_os = "macos") { "dylib" } else { "so.2" };
        let path = folder.path().join(format!("libOpenImageDenoise.{name}"));
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oidn/fake.c");
        let mut compiler = Command::new("cc");
        compiler.args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]);
        compiler.arg(format!("-DLOG=\"{}\"", folder.path().join("log").display()));
        compiler.args(macros.iter().map(|text| format!("-D{text}")));
        compiler.arg(source).arg("-o").arg(&path);
        let status = compiler.status().expect("a C compiler, cc");
        assert!(status.success(), "{compiler:?}");
        Self { folder, path }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn device(&self) -> Result<Device, Error> {
        Device::new(&Library::load(&self.path)?)
    }

    /// The calls so far.
    pub(crate) fn log(&self) -> Vec<String> {
        let text = fs::read_to_string(self.folder().join("log")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }

    /// How often a function was called.
    pub(crate) fn calls(&self, function: &str) -> usize {
        let is_it = |line: &String| line.split(' ').next() == Some(function);
        self.log().iter().filter(|line| is_it(line)).count()
    }

    /// What is wrong with the calls after the last object was dropped.
    pub(crate) fn faults(&self) -> Vec<String> {
        faults(&self.log())
    }
}

/// What the library complained of, and the objects that were not released once, or later than
/// their device.
pub(crate) fn faults(log: &[String]) -> Vec<String> {
    let mut found: Vec<String> =
        log.iter().filter(|line| line.starts_with("FAULT")).cloned().collect();
    let mut alive = BTreeMap::new();
    for line in log {
        let words: Vec<&str> = line.split(' ').collect();
        if let Some(("", kind)) = words[0].split_once("oidnNew") {
            let id = words[words.len() - 1];
            if id != "0" {
                alive.insert(id, kind);
            }
        } else if let Some(("", kind)) = words[0].split_once("oidnRelease") {
            if alive.remove(words[1]) != Some(kind) {
                found.push(format!("released too often: {line}"));
            }
            if kind == "Device" && !alive.is_empty() {
                found.push(format!("released too late: {alive:?}"));
            }
        }
    }
    if !alive.is_empty() {
        found.push(format!("never released: {alive:?}"));
    }
    found
}

#[test]
fn faults_are_seen() {
    let faults =
        |log: &[&str]| faults(&log.iter().map(|&line| line.to_owned()).collect::<Vec<_>>());
    let new = ["oidnNewDevice 0 = 1", "oidnNewBuffer 1 12 = 2", "oidnNewBuffer 1 12 = 0"];
    let good = [&new[..], &["oidnReleaseBuffer 2", "oidnReleaseDevice 1"]].concat();
    assert!(faults(&good).is_empty());
    assert_eq!(faults(&good[..4]).len(), 1);
    assert_eq!(faults(&[&good[..], &["oidnReleaseBuffer 2"]].concat()).len(), 1);
    assert_eq!(faults(&[&good[..], &["FAULT: x"]].concat()).len(), 1);
    let late = [&new[..], &["oidnReleaseDevice 1", "oidnReleaseBuffer 2"]].concat();
    assert_eq!(faults(&late).len(), 1);
    let kinds = [&new[..], &["oidnReleaseFilter 2", "oidnReleaseDevice 1"]].concat();
    assert_eq!(faults(&kinds).len(), 1);
}
