//! Which library is loaded, and which is refused.

use std::{
    env, fs,
    path::Path,
    process::{Command, Output},
};

use nst_oidn::{Device, Error, Library};

use crate::fake::Fake;

const FUNCTIONS: [&str; 15] = [
    "oidnNewDevice",
    "oidnCommitDevice",
    "oidnGetDeviceInt",
    "oidnGetDeviceError",
    "oidnReleaseDevice",
    "oidnNewBuffer",
    "oidnWriteBuffer",
    "oidnReadBuffer",
    "oidnReleaseBuffer",
    "oidnNewFilter",
    "oidnSetFilterImage",
    "oidnSetFilterBool",
    "oidnCommitFilter",
    "oidnExecuteFilter",
    "oidnReleaseFilter",
];

#[test]
fn a_library_that_lacks_a_function_is_refused() {
    for function in FUNCTIONS {
        // The function has another name.
        let fake = Fake::new(&[&format!("{function}=another")]);
        let error = Library::load(fake.path()).expect_err("an incomplete library");
        let Error::Function { path, function: named } = &error else { panic!("{error}") };
        assert_eq!((path.as_path(), *named), (fake.path(), function));
        assert!(error.to_string().contains(&format!("has no function {function}: ")), "{error}");
        assert!(fake.log().is_empty());
    }
}

/// It has functions of the same names, and calls by others' rules.
#[test]
fn version_1_is_refused_before_it_is_called() {
    let fake = Fake::new(&["oidnGetDeviceInt=oidnGetDevice1i"]);
    let error = Library::load(fake.path()).expect_err("version 1");
    assert!(matches!(error, Error::VersionOne { .. }), "{error}");
    let begin = format!("'{}' is Open Image Denoise 1; install ", fake.path().display());
    assert!(error.to_string().starts_with(&begin), "{error}");
    assert!(fake.log().is_empty());
}

#[test]
fn other_versions_than_2_are_refused() {
    for (version, name) in [(19_999, "1.99.99"), (30_102, "3.1.2"), (0, "0.0.0")] {
        let fake = Fake::new(&[&format!("VERSION={version}")]);
        let error = fake.device().expect_err("another version").to_string();
        let begin = format!("'{}' is Open Image Denoise {name}; install ", fake.path().display());
        assert!(error.starts_with(&begin), "{error}");
        assert!(fake.faults().is_empty());
    }
}

#[test]
fn what_is_no_library_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("library.so");
    fs::write(&path, "no library").expect("a file is written");
    for path in [path.as_path(), folder.path(), &folder.path().join("none.so")] {
        let error = Library::load(path).expect_err("no library").to_string();
        let begin = format!("'{}' cannot be loaded: ", path.display());
        assert!(error.starts_with(&begin) && error.contains("OIDN_LIBRARY"), "{error}");
    }
}

/// Set for a process that [`child`] starts.
const CHILD: &str = "NST_OIDN_TEST_CHILD";

/// Runs a test alone in a process with these environment variables, in this folder. There it
/// does what [`find_and_say`] does.
fn child(test: &str, folder: &Path, variables: &[(&str, &Path)]) -> Output {
    let mut command = Command::new(env::current_exe().expect("this program"));
    command.args(["--exact", test, "--nocapture"]);
    for name in ["OIDN_LIBRARY", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "VIRTUAL_ENV"] {
        command.env_remove(name);
    }
    command.env(CHILD, "1").envs(variables.iter().copied()).current_dir(folder);
    command.output().expect("a process")
}

fn is_child() -> bool {
    env::var_os(CHILD).is_some()
}

/// Finds a library by the process's own environment; says what is tried, and what comes of it.
fn find_and_say() {
    let found = Library::find(|candidate| eprintln!("trying {candidate}"));
    match found.and_then(|library| Device::new(&library.expect("a library"))) {
        Ok(device) => eprintln!("found {}", device.path().display()),
        Err(error) => eprintln!("error: {error}"),
    }
}

/// The lines that [`find_and_say`] wrote.
fn said(output: &Output) -> Vec<String> {
    let text = String::from_utf8_lossy(&output.stderr);
    let begins = ["trying ", "found ", "error: "];
    let ours = text.lines().filter(|line| begins.iter().any(|begin| line.starts_with(begin)));
    ours.map(str::to_owned).collect()
}

#[test]
fn the_variable_decides() {
    if is_child() {
        return find_and_say();
    }
    let fake = Fake::new(&[]);
    let test = "loading::the_variable_decides";
    for path in [fake.path(), fake.folder()] {
        let output = child(test, fake.folder(), &[("OIDN_LIBRARY", path)]);
        assert!(output.status.success());
        let file = fake.path().display();
        let expected = [format!("trying {file} (named by OIDN_LIBRARY)"), format!("found {file}")];
        assert_eq!(said(&output), expected);
    }
    // The system's loader would search for a name without a folder elsewhere.
    let name = fake.path().file_name().map(Path::new).expect("a name");
    let output = child(test, fake.folder(), &[("OIDN_LIBRARY", name)]);
    let place = fake.path().canonicalize().expect("the file exists");
    let tried = format!("trying {} (named by OIDN_LIBRARY)", name.display());
    assert_eq!(said(&output), [tried, format!("found {}", place.display())]);

    let output = child(test, fake.folder(), &[("OIDN_LIBRARY", Path::new("/none"))]);
    let [error] = said(&output).try_into().expect("one line");
    assert!(error.starts_with("error: OIDN_LIBRARY: '/none' is neither "), "{error}");
}

#[test]
fn a_library_that_cannot_be_loaded_is_passed_over() {
    if is_child() {
        return find_and_say();
    }
    let (fake, broken) = (Fake::new(&[]), tempfile::tempdir().expect("a temporary folder"));
    let file = broken.path().join(fake.path().file_name().expect("a name"));
    fs::write(&file, "no library").expect("a file is written");
    let name = if cfg!(target_os = "macos") { "DYLD_LIBRARY_PATH" } else { "LD_LIBRARY_PATH" };
    let folders = env::join_paths([broken.path(), fake.folder()]).expect("paths");
    let test = "loading::a_library_that_cannot_be_loaded_is_passed_over";
    let output = child(test, fake.folder(), &[(name, Path::new(&folders))]);
    let expected = [
        format!("trying {} (installed)", file.display()),
        format!("trying {} (installed)", fake.path().display()),
        format!("found {}", fake.path().display()),
    ];
    assert_eq!(said(&output), expected);
    // Where no other is tried, its error is that of all.
    let output = child(test, fake.folder(), &[("OIDN_LIBRARY", &file)]);
    let [_, error] = said(&output).try_into().expect("two lines");
    assert!(
        error.starts_with(&format!("error: '{}' cannot be loaded: ", file.display())),
        "{error}"
    );
}

/// Nothing can be done about that, but to have said which file it is.
#[test]
fn a_library_that_crashes_has_been_named() {
    if is_child() {
        return find_and_say();
    }
    let fake = Fake::new(&["CRASH"]);
    let test = "loading::a_library_that_crashes_has_been_named";
    let output = child(test, fake.folder(), &[("OIDN_LIBRARY", fake.path())]);
    assert!(!output.status.success());
    let named = format!("trying {} (named by OIDN_LIBRARY)", fake.path().display());
    assert_eq!(said(&output), [named]);
}
