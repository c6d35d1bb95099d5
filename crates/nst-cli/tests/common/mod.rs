//! Runs the `nst` binary in a folder of its own.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    path::{Path, PathBuf},
    process::{Command, Output},
    time::SystemTime,
};

use nst_files::picture::Picture;
use tempfile::TempDir;

#[allow(dead_code, reason = "only benches write tables")]
pub(crate) mod tables;

/// Programs that a test starts from now on end at Ctrl-C and SIGHUP, as programs do. Without
/// it, they ignore both where the tests themselves run under `nohup` or behind `&`.
#[cfg(unix)]
#[allow(dead_code, reason = "only some tests send signals")]
pub(crate) fn heed_signals() {
    for signal in [libc::SIGINT, libc::SIGHUP, libc::SIGTERM] {
        #[allow(unsafe_code, reason = "there is no safe way to set it")]
        // SAFETY: no handler is installed that could be interrupted, or interrupt.
        let _ = unsafe { libc::signal(signal, libc::SIG_DFL) };
    }
}

/// By name: whether it is a link, when it was written, and the content.
pub(crate) type Snapshot = BTreeMap<OsString, (bool, SystemTime, Vec<u8>)>;

/// A temporary folder in which `nst` runs.
pub(crate) struct Bench {
    folder: TempDir,
}

#[allow(dead_code, reason = "no test needs all of it")]
impl Bench {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).expect("a file in the temporary folder");
    }

    pub(crate) fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).expect("the temporary folder");
        let name = |entry: std::io::Result<std::fs::DirEntry>| {
            entry.expect("an entry").file_name().to_string_lossy().into_owned()
        };
        let mut names: Vec<_> = entries.map(name).collect();
        names.sort();
        names
    }

    /// All that is in the folder: what each name stands for, when it was written, and what
    /// it contains, through links.
    pub(crate) fn snapshot(&self) -> Snapshot {
        let entries = std::fs::read_dir(self.folder.path()).expect("the temporary folder");
        let entry = |entry: std::io::Result<std::fs::DirEntry>| {
            let path = entry.expect("an entry").path();
            let metadata = path.symlink_metadata().expect("it is there");
            let written = metadata.modified().expect("file systems know");
            let content = std::fs::read(&path).unwrap_or_default();
            (
                path.file_name().expect("a name").to_owned(),
                (metadata.is_symlink(), written, content),
            )
        };
        entries.map(entry).collect()
    }

    /// Runs `nst`, which must refuse: exit code 2, one error that contains all of `words`,
    /// and a folder in which nothing has changed.
    pub(crate) fn refuses(&self, args: &str, words: &[&str]) {
        let before = self.snapshot();
        let output = self.nst(args);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "nst {args}\n{stderr}");
        assert_eq!(stderr.matches("error:").count(), 1, "nst {args}\n{stderr}");
        for word in words {
            assert!(stderr.contains(word), "nst {args}\n'{word}' is not in: {stderr}");
        }
        assert!(self.snapshot() == before, "nst {args}: a file has changed");
    }

    /// Runs `nst` with arguments separated by spaces.
    pub(crate) fn nst(&self, args: &str) -> Output {
        self.nst_with(args, &[])
    }

    /// Runs `nst` with further environment variables.
    pub(crate) fn nst_with(&self, args: &str, variables: &[(&str, &str)]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_nst"))
            .args(args.split_whitespace())
            .envs(variables.iter().copied())
            .current_dir(self.folder.path())
            .output()
            .expect("the binary runs")
    }

    /// Whether there is an adapter, as NST_GPU allows; says so if there is none.
    pub(crate) fn has_gpu(&self) -> bool {
        let mode = std::env::var("NST_GPU").unwrap_or_else(|_| "auto".into());
        let options = "--spp 8 --size 4x4 --transform cornell --backend gpu";
        let probe = format!("render --scene {} {options}", cornell());
        let usable = mode != "off" && self.nst(&probe).status.success();
        assert!(usable || mode != "require", "NST_GPU=require, but --backend gpu fails");
        if !usable {
            eprintln!("skipped: NST_GPU={mode} and no adapter");
        }
        usable
    }

    /// Runs `nst`, which must succeed, and returns its standard output.
    pub(crate) fn succeed(&self, args: &str) -> String {
        let output = self.nst(args);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "nst {args}: {stderr}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }
}

/// A layer of an EXR picture as planar lanes, with the picture's size; the main picture
/// has no name.
#[allow(dead_code, reason = "no test needs all of it")]
pub(crate) fn read_layer(path: &Path, layer: &str) -> ([u32; 2], Vec<f32>) {
    let layer = (!layer.is_empty()).then_some(layer);
    let picture = Picture::open(path, layer).expect("a picture");
    (picture.size, picture.read().expect("its pixels"))
}

/// The Cornell box of this repository.
pub(crate) fn cornell() -> String {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell/cornell.obj");
    scene.canonicalize().expect("the scene").display().to_string()
}
