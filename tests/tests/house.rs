//! The house as ARCHITECTURE.md draws it: which crate uses which, and that inside a
//! crate no module imports one that imports it, directly or by way of others.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a workspace member").to_owned()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// What each crate uses of the others, by the lines of their names, joined with arrows: all
/// that stand to its right.
fn drawn(architecture: &str) -> BTreeMap<String, BTreeSet<String>> {
    let lines = architecture.lines().map(|line| line.split("──►").map(str::trim).collect());
    let is_crate = |name: &&str| name.starts_with("nst-") && !name.contains(' ');
    let mut drawn: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for chain in lines.filter(|names: &Vec<&str>| names.iter().all(is_crate)) {
        for (i, &name) in chain.iter().enumerate() {
            let right = chain[i + 1..].iter().map(|&name| name.to_owned());
            drawn.entry(name.to_owned()).or_default().extend(right);
        }
    }
    drawn
}

/// What each crate uses of the others, by the section `[dependencies]` of its manifest.
fn real() -> BTreeMap<String, BTreeSet<String>> {
    let crates = std::fs::read_dir(repository().join("crates")).expect("the crates' folder");
    let crates = crates.map(|entry| entry.expect("an entry").path());
    crates
        .map(|folder| {
            let manifest = read(&folder.join("Cargo.toml"));
            let sections = manifest.split("\n[");
            let section = sections.filter_map(|section| section.strip_prefix("dependencies]"));
            let names = section.flat_map(str::lines).filter(|line| line.starts_with("nst-"));
            let end = |c: char| c == '.' || c == ' ' || c == '=';
            let names = names.filter_map(|line| line.split(end).next()).map(str::to_owned);
            let name = folder.file_name().expect("a folder").to_string_lossy().into_owned();
            (name, names.collect())
        })
        .collect()
}

#[test]
fn crates_use_each_other_as_drawn() {
    let architecture = read(&repository().join("ARCHITECTURE.md"));
    assert_eq!(drawn(&architecture), real());
    // Arrows that run back or are missing would be seen, and so would crates.
    for (right, wrong) in [
        ("nst-files ──► nst-core", "nst-core ──► nst-files"),
        ("    nst-cli ──► nst-oidn\n", "    nst-core ──► nst-oidn\n"),
        ("    nst-cli ──► nst-oidn\n", ""),
    ] {
        assert!(architecture.contains(right));
        assert_ne!(drawn(&architecture.replace(right, wrong)), real());
    }
}

/// The modules of a crate by their paths, as in `gpu::mlp`, without their unit tests.
fn modules(sources: &Path) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut folders = vec![sources.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let within = path.strip_prefix(sources).expect("a file of the crate");
                let name = within.with_extension("").to_string_lossy().replace('/', "::");
                let name = name.strip_suffix("::mod").unwrap_or(&name).to_owned();
                // What the crate's root says is what others may import, not an import.
                if !["lib", "main"].contains(&name.as_str()) {
                    let source = read(&path);
                    let code = source.split("#[cfg(test)]\n").next().unwrap_or_default();
                    found.insert(name, code.to_owned());
                }
            }
        }
    }
    found
}

/// The paths that the `use` declarations of a source name, written out: `a::{b, c::d}` is
/// `a::b` and `a::c::d`. Whether they are public comes with them.
fn uses(source: &str) -> Vec<(bool, Vec<String>)> {
    let mut found = Vec::new();
    for statement in source.split(';') {
        let Some(at) = statement.lines().position(|line| {
            let line = line.trim_start();
            line.starts_with("use ") || (line.starts_with("pub") && line.contains(" use "))
        }) else {
            continue;
        };
        let text = statement.lines().skip(at).collect::<Vec<_>>().join(" ");
        let (before, tree) = text.split_once("use ").expect("it was found");
        let public = before.contains("pub");
        found.extend(expand(tree, &[]).into_iter().map(|path| (public, path)));
    }
    found
}

fn expand(tree: &str, prefix: &[String]) -> Vec<Vec<String>> {
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for c in tree.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            parts.push(String::new());
        } else {
            parts.last_mut().expect("there is one").push(c);
        }
    }
    let parts = parts.iter().map(|part| part.trim()).filter(|part| !part.is_empty());
    parts
        .flat_map(|part| {
            let (path, rest) = part.split_once('{').unwrap_or((part, ""));
            let names = path.split(" as ").next().unwrap_or_default().split("::");
            let names = names.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty());
            let path: Vec<String> = prefix.iter().cloned().chain(names).collect();
            match rest.rsplit_once('}') {
                Some((inner, _)) => expand(inner, &path),
                None => vec![path],
            }
        })
        .collect()
}

/// Which module a path leads to, seen from a module: as far as modules go, and through
/// what they pass on. `None` if it leads out of the crate.
fn target(modules: &BTreeMap<String, String>, from: &str, path: &[String]) -> Option<String> {
    let mut at: Vec<String> = from.split("::").map(str::to_owned).collect();
    let mut names = path.iter();
    let first = names.clone().next()?;
    match first.as_str() {
        "crate" => at.clear(),
        "self" | "super" => {}
        name if modules.contains_key(&[from, name].join("::")) => {}
        _ => return None,
    }
    let mut rest = Vec::new();
    for name in names.by_ref() {
        match name.as_str() {
            "crate" | "self" => {}
            "super" => drop(at.pop()),
            _ => {
                rest.push(name.clone());
                break;
            }
        }
    }
    rest.extend(names.cloned());
    for (i, name) in rest.iter().enumerate() {
        let next = at.iter().chain([name]).cloned().collect::<Vec<_>>().join("::");
        if modules.contains_key(&next) {
            at.push(name.clone());
            continue;
        }
        // A name that the module passes on.
        let here = at.join("::");
        let passed = uses(modules.get(&here)?).into_iter().find_map(|(public, path)| {
            (public && path.last() == Some(name)).then(|| target(modules, &here, &path)).flatten()
        });
        return Some(passed.filter(|_| i + 1 == rest.len()).unwrap_or(here));
    }
    Some(at.join("::"))
}

/// Modules that reach themselves by their imports.
fn circles(modules: &BTreeMap<String, String>) -> BTreeSet<&str> {
    let imports = |name: &str| -> BTreeSet<String> {
        let paths = uses(&modules[name]).into_iter();
        let targets = paths.filter_map(|(_, path)| target(modules, name, &path));
        targets.filter(|target| target != name && modules.contains_key(target)).collect()
    };
    let graph: BTreeMap<&str, BTreeSet<String>> =
        modules.keys().map(|name| (name.as_str(), imports(name))).collect();
    let reaches_itself = |start: &&str| {
        let (mut seen, mut waiting) = (BTreeSet::new(), vec![*start]);
        while let Some(name) = waiting.pop() {
            for next in &graph[name] {
                if next == *start {
                    return true;
                }
                if seen.insert(next.as_str()) {
                    waiting.push(next);
                }
            }
        }
        false
    };
    graph.keys().copied().filter(reaches_itself).collect()
}

#[test]
fn no_module_imports_what_imports_it() {
    for name in real().keys() {
        let modules = modules(&repository().join("crates").join(name).join("src"));
        assert!(modules.len() > 10, "{name}: {} modules", modules.len());
        assert_eq!(circles(&modules), BTreeSet::new(), "{name}");
    }
}

/// The check must see circles, by any kind of path.
#[test]
fn circles_are_seen() {
    let found = |sources: &[(&str, &str)]| {
        let modules = sources.iter().map(|&(name, code)| (name.to_owned(), code.to_owned()));
        let modules: BTreeMap<_, _> = modules.collect();
        circles(&modules).into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let straight = [("a", "use crate::b::B;\n"), ("b", "use std::fmt;\n\npub struct B;\n")];
    assert!(found(&straight).is_empty());
    assert_eq!(found(&[("a", "use crate::b::B;\n"), ("b", "use crate::a::A;\n")]), ["a", "b"]);
    // Through a parent that passes a name on, and through braces.
    let passed = [
        ("a", "use crate::{c::X, d::Y};\n"),
        ("c", "mod x;\n\npub use x::X;\n"),
        ("c::x", "use super::super::a::A;\n"),
        ("d", ""),
    ];
    assert_eq!(found(&passed), ["a", "c::x"]);
    // A parent that defines what its child uses, and uses its child.
    let parent = [("c", "mod x;\nuse x::X;\nstruct C;\n"), ("c::x", "use super::C;\n")];
    assert_eq!(found(&parent), ["c", "c::x"]);
}
