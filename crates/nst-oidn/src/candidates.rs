//! Which files may be the library.

use std::{
    collections::BTreeSet,
    fmt,
    path::{Path, PathBuf},
};

use crate::{
    Error, Version,
    environment::{Environment, OIDN_LIBRARY, entries},
    python, system,
};

/// The library's file names: the first is that of version 2 alone.
const NAMES: &[&str] = if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else {
    &["libOpenImageDenoise.so.2"]
};

/// How the name of the library begins, and that of a part of it, which always says the version.
const STEM: &str = "libOpenImageDenoise.";
const PART: &str = "libOpenImageDenoise_core.";

/// Where a file was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Source {
    /// The environment variable `OIDN_LIBRARY` names it.
    Variable,
    /// It is where the system's loader looks.
    System,
    /// It belongs to Python's package `pyoidn`.
    Python,
}

/// A file that may be the library. It exists; nothing of it has been loaded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    path: PathBuf,
    source: Source,
}

impl Candidate {
    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where it was found.
    #[must_use]
    pub fn source(&self) -> Source {
        self.source
    }

    /// The version, if the names of files say it: of what the file is a link to, or of the part of
    /// the library that is beside it. What has been loaded says it itself.
    #[must_use]
    pub fn version(&self) -> Option<Version> {
        let file = self.path.canonicalize().ok()?;
        let own = |path: &Path| Version::of_name(path.file_name()?.to_str()?.strip_prefix(STEM)?);
        let of_part =
            |path: &PathBuf| Version::of_name(path.file_name()?.to_str()?.strip_prefix(PART)?);
        own(&file).or_else(|| {
            let parts: BTreeSet<Version> =
                entries(file.parent()?).iter().filter_map(of_part).collect();
            parts.first().copied().filter(|_| parts.len() == 1)
        })
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match self.source {
            Source::Variable => "named by OIDN_LIBRARY",
            Source::System => "installed",
            Source::Python => "of Python's package pyoidn",
        };
        write!(f, "{} ({source})", self.path.display())
    }
}

/// The files that may be Open Image Denoise, the preferred one first: what the environment
/// variable `OIDN_LIBRARY` names, and nothing else then; where the system's loader looks;
/// Python's package `pyoidn`. Reads folders, and loads nothing.
///
/// # Errors
/// [`Error::Missing`] if `OIDN_LIBRARY` is set, and names neither a file nor a folder in
/// which, or in whose `lib` or `bin`, there is one.
pub fn candidates() -> Result<Vec<Candidate>, Error> {
    within(&Environment::current())
}

fn within(environment: &Environment) -> Result<Vec<Candidate>, Error> {
    if let Some(named) = environment.path(OIDN_LIBRARY) {
        let path = at(&named).ok_or(Error::Missing { path: named, name: NAMES[0] })?;
        return Ok(vec![Candidate { path, source: Source::Variable }]);
    }
    let system = system::folders(environment).into_iter().map(|folder| (folder, Source::System));
    let python = python::folders(environment).into_iter().map(|folder| (folder, Source::Python));
    let found =
        system.chain(python).filter_map(|(folder, source)| Some((inside(&folder)?, source)));
    // A folder may be reached by several names.
    let mut seen = BTreeSet::new();
    let new = found.filter(|(path, _)| seen.insert(path.canonicalize().ok()));
    Ok(new.map(|(path, source)| Candidate { path, source }).collect())
}

/// What a user names: the library itself, its folder, or the folder of an unpacked release.
fn at(named: &Path) -> Option<PathBuf> {
    if named.is_file() {
        return Some(named.to_owned());
    }
    [named.to_owned(), named.join("lib"), named.join("bin")].iter().find_map(|path| inside(path))
}

/// The library in a folder.
fn inside(folder: &Path) -> Option<PathBuf> {
    NAMES.iter().map(|name| folder.join(name)).find(|path| path.is_file())
}

#[cfg(all(test, unix))]
mod tests {
    use std::{collections::BTreeMap, ffi::OsString, fs};

    use super::*;
    use crate::environment::LOADER_PATH;

    /// A file system of its own, with these files.
    fn tree(files: &[&str]) -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("a temporary folder");
        for file in files {
            let path = root.path().join(file);
            fs::create_dir_all(path.parent().expect("a folder")).expect("folders are made");
            fs::write(path, "").expect("a file is written");
        }
        root
    }

    /// What is found with these variables, whose paths begin in the tree; its paths without
    /// the tree's.
    fn found(
        root: &Path,
        variables: &[(&'static str, &str)],
    ) -> Result<Vec<(String, Source)>, Error> {
        let rooted = |list: &str| -> OsString {
            let folders = list.split(':').map(|folder| match folder {
                "" => PathBuf::new(),
                folder => root.join(folder),
            });
            std::env::join_paths(folders).expect("paths without colons")
        };
        let variables: BTreeMap<_, _> =
            variables.iter().map(|&(name, list)| (name, rooted(list))).collect();
        let candidates = within(&Environment { variables, root: root.to_owned() })?;
        let within = |candidate: Candidate| {
            let path = candidate.path().strip_prefix(root).expect("in the tree").to_owned();
            (path.to_string_lossy().into_owned(), candidate.source())
        };
        Ok(candidates.into_iter().map(within).collect())
    }

    fn library(folder: &str) -> String {
        format!("{folder}/{}", NAMES[0])
    }

    #[test]
    fn what_the_variable_names_is_the_only_one() {
        let [system, release] = [library("usr/local/lib"), library("release/lib")];
        let root = tree(&[&system, &release, "other.so", "empty/readme"]);
        let found = |value| found(root.path(), &[(OIDN_LIBRARY, value)]);
        let only = |path: &str| vec![(path.to_owned(), Source::Variable)];
        assert_eq!(found("other.so").expect("a file"), only("other.so"));
        assert_eq!(found("release/lib").expect("its folder"), only(&release));
        assert_eq!(found("release").expect("a release"), only(&release));
        // An empty value is none.
        assert_eq!(found("").expect("no value"), [(system, Source::System)]);
        for missing in ["none.so", "empty"] {
            let error = found(missing).expect_err("there is no library").to_string();
            let begin = format!("OIDN_LIBRARY: '{}/{missing}' is neither", root.path().display());
            assert!(error.starts_with(&begin) && error.contains(NAMES[0]), "{error}");
        }
    }

    #[test]
    fn the_loaders_folders_come_before_python() {
        let usual = if cfg!(target_os = "macos") { "opt/homebrew/lib" } else { "usr/lib64" };
        let python = "env/lib/python3.12/site-packages/pyoidn/oidn/lib";
        let [first, second, third] = ["first", usual, python].map(library);
        let root = tree(&[&first, &second, &third]);
        // The same folder twice, an empty one, and one that is not there.
        let variables = [(LOADER_PATH, "none:first::first"), ("VIRTUAL_ENV", "env")];
        let found = found(root.path(), &variables).expect("libraries");
        let expected = [(first, Source::System), (second, Source::System), (third, Source::Python)];
        assert_eq!(found, expected);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_loaders_configuration_is_read() {
        let names = ["usr/lib/here", "opt/a", "opt/b", "opt/c", "opt/d"];
        let [here, a, b, c, d] = names.map(library);
        let root = tree(&[&here, &a, &b, &c, &d]);
        let conf = root.path().join("etc/ld.so.conf.d");
        fs::create_dir_all(&conf).expect("a folder");
        let write = |name: &str, text: &str| {
            fs::write(conf.join(name), text).expect("a file is written");
        };
        write("../ld.so.conf", "# /opt/d\ninclude ld.so.conf.d/*.conf\n/opt/c # why\n");
        write("b.conf", "/opt/b\n");
        // A circle, by an absolute path.
        write("a.conf", "  /usr/lib/here\n/opt/a\ninclude /etc/ld.so.conf.d/a.conf\n");
        write("d.off", "/opt/d\n");
        let found = found(root.path(), &[]).expect("libraries");
        assert_eq!(found, [here, a, b, c].map(|path| (path, Source::System)));
    }

    #[test]
    fn pythons_packages_are_searched() {
        let packages = |folder: &str| library(&format!("{folder}/pyoidn/oidn/lib"));
        let active = packages("env/lib/python3.9/site-packages");
        let [old, new, local, user] = [
            packages("usr/lib/python3/dist-packages"),
            packages("usr/lib/python3.11/dist-packages"),
            packages("usr/local/lib/python3.11/dist-packages"),
            packages("home/me/.local/lib/python3.13/site-packages"),
        ];
        let not_first = packages("other/lib/python3.12/site-packages");
        let files = [&active, &old, &new, &local, &user, &not_first].map(String::as_str);
        let root = tree(&files);
        for program in ["usr/bin/python3", "other/bin/python3"] {
            let path = root.path().join(program);
            fs::create_dir_all(path.parent().expect("a folder")).expect("folders are made");
            fs::write(path, "").expect("a file is written");
        }
        let variables =
            [("VIRTUAL_ENV", "env"), ("PATH", "none:usr/bin:other/bin"), ("HOME", "home/me")];
        let found = found(root.path(), &variables).expect("libraries");
        let expected = [active, new, old, local, user].map(|path| (path, Source::Python));
        assert_eq!(found, expected);
        // Python 2 and folders of other names are none of Python 3's.
        let root =
            tree(&[&packages("env/lib/python2.7/site-packages"), &packages("env/lib/pythons")]);
        let none = super::tests::found(root.path(), &[("VIRTUAL_ENV", "env")]);
        assert_eq!(none.expect("nothing"), []);
    }

    /// A virtual environment's `python3` is a link to that of the system.
    #[test]
    fn links_of_pythons_are_followed() {
        let behind = library("py/lib/python3.12/site-packages/pyoidn/oidn/lib");
        let root = tree(&[&behind, "py/bin/python3.12", "bin/readme"]);
        let target = root.path().join("py/bin/python3.12");
        std::os::unix::fs::symlink(target, root.path().join("bin/python3")).expect("a link");
        let found = found(root.path(), &[("PATH", "bin")]).expect("a library");
        assert_eq!(found, [(behind, Source::Python)]);
    }

    #[test]
    fn names_of_files_say_the_version() {
        let version = |files: &[&str], link: Option<&str>| {
            let root = tree(files);
            let path = root.path().join(NAMES[0]);
            match link {
                Some(file) => std::os::unix::fs::symlink(file, &path).expect("a link"),
                None => fs::write(&path, "").expect("a file is written"),
            }
            let version = Candidate { path, source: Source::System }.version();
            version.map(|version| version.to_string())
        };
        let linked = "libOpenImageDenoise.so.2.5.1";
        let [core, older] =
            ["2.3.0", "2.1.0"].map(|it| format!("libOpenImageDenoise_core.so.{it}"));
        assert_eq!(version(&[linked, &core], Some(linked)), Some("2.5.1".into()));
        assert_eq!(version(&[&core, "libother.so.2.9.9"], None), Some("2.3.0".into()));
        // Two of them, or a name that says less.
        assert_eq!(version(&[&core, &older], None), None);
        assert_eq!(version(&["libOpenImageDenoise_core.so.2"], None), None);
        let apple = "libOpenImageDenoise_core.2.4.0.dylib";
        assert_eq!(version(&[apple], None), Some("2.4.0".into()));
    }

    #[test]
    fn candidates_say_where_they_are() {
        let candidate = |source| Candidate { path: "/a/b.so".into(), source }.to_string();
        assert_eq!(candidate(Source::Variable), "/a/b.so (named by OIDN_LIBRARY)");
        assert_eq!(candidate(Source::System), "/a/b.so (installed)");
        assert_eq!(candidate(Source::Python), "/a/b.so (of Python's package pyoidn)");
    }
}
