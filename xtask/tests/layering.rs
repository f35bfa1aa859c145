//! Which crate may depend on which, and within `bvh-update` which folder on which; arrows go one
//! way only. And the README names the command that runs these tests.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lab::files::workspace;
use serde_json::Value;

/// For each crate of the workspace, the others of the workspace that it may depend on.
const ALLOWED: [(&str, &[&str]); 18] = [
    ("bvh-core", &[]),
    ("bvh-build", &["bvh-core"]),
    ("bvh-update", &["bvh-core", "bvh-build"]),
    ("bvh-related", &["bvh-core", "bvh-build", "bvh-update"]),
    ("pivot-bvh", &["bvh-core", "bvh-build", "bvh-update"]),
    ("rt-cpu", &["bvh-core"]),
    ("anim", &[]),
    ("scenes", &["anim"]),
    ("stage", &["bvh-core", "bvh-build", "bvh-update", "rt-cpu", "anim", "scenes"]),
    ("viewer-core", &["bvh-core", "bvh-build", "bvh-update", "rt-cpu", "anim", "scenes", "stage"]),
    ("viewer", &["bvh-update", "anim", "scenes", "viewer-core"]),
    ("viewer-web", &["anim", "scenes", "stage", "viewer-core"]),
    ("lab", LAB),
    ("xtask", &["lab", "scenes"]),
    ("pivot-tests", LIBRARIES),
    ("pivot-fingerprints", &["bvh-core", "bvh-build", "bvh-update", "rt-cpu", "scenes", "stage"]),
    ("pivot-benches", LIBRARIES),
    ("pivot-examples", LIBRARIES),
];

const LIBRARIES: &[&str] = &["bvh-core", "bvh-build", "bvh-update", "pivot-bvh", "rt-cpu", "anim", "scenes"];

const LAB: &[&str] = &[
    "bvh-core",
    "bvh-build",
    "bvh-update",
    "bvh-related",
    "rt-cpu",
    "anim",
    "scenes",
    "stage",
    "pivot-benches",
];

/// Dependencies that a crate may have for its tests alone, beyond those.
const ALLOWED_IN_TESTS: [(&str, &[&str]); 2] = [("rt-cpu", &["bvh-build"]), ("viewer", &["lab"])];

/// The folders and files of `bvh-update`, each of which may import only those before it.
const UPDATE_MODULES: [&str; 12] = [
    "ski_rental",
    "sleep",
    "state",
    "report",
    "refit",
    "quality",
    "rebuild",
    "repair",
    "workspace",
    "auto",
    "strategy",
    "update",
];

/// Every edge between crates of the workspace that is not allowed, and every crate that is not
/// known here.
fn violations(metadata: &str) -> Vec<String> {
    let metadata: Value = serde_json::from_str(metadata).expect("JSON");
    let list = |of: &Value| of.as_array().expect("a list, as cargo metadata prints it").clone();
    let name = |of: &Value| of["name"].as_str().expect("a name").to_owned();
    let packages = list(&metadata["packages"]);
    let members: Vec<String> = packages.iter().map(name).collect();
    let (allowed, in_tests) = (BTreeMap::from(ALLOWED), BTreeMap::from(ALLOWED_IN_TESTS));
    let mut found = Vec::new();
    for (package, from) in packages.iter().zip(&members) {
        let Some(may) = allowed.get(from.as_str()) else {
            found.push(format!("{from} is not in the list of crates in xtask/tests/layering.rs"));
            continue;
        };
        for dependency in list(&package["dependencies"]) {
            let to = name(&dependency);
            let for_tests = dependency["kind"] == "dev"
                && in_tests.get(from.as_str()).is_some_and(|names| names.contains(&to.as_str()));
            if members.contains(&to) && !may.contains(&to.as_str()) && !for_tests {
                found.push(format!("{from} must not depend on {to}"));
            }
        }
    }
    found
}

/// Every import within `bvh-update` that goes against the order of its modules, and every module
/// that is not known here; `source` is its folder of sources.
fn module_violations(source: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for file in rust_files(source) {
        let first = file.strip_prefix(source).expect("below it").iter().next().unwrap_or_default();
        let module = Path::new(first).file_stem().unwrap_or_default();
        let name = file.display();
        match UPDATE_MODULES.iter().position(|known| module == *known) {
            Some(rank) => {
                let text = fs::read_to_string(&file).expect("a source");
                found.extend(imports_against(&text, rank).map(|to| format!("{name} must not import {to}")));
            }
            None if module == "lib" => {}
            None => found.push(format!("{name} is not in the list of modules in xtask/tests/layering.rs")),
        }
    }
    found
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files
}

/// The modules named after `crate::` outside of tests and comments that a module of this rank may
/// not import.
fn imports_against(text: &str, rank: usize) -> impl Iterator<Item = &'static str> {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let lines: Vec<_> = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let is_between = |c: char| !c.is_ascii_alphanumeric() && c != '_';
    // One name, or all of those in braces: that of an item counts, too, if it is that of a module.
    let names = |rest: &str| -> Vec<String> {
        let is_end = |c: char| if rest.starts_with('{') { c == ';' } else { is_between(c) };
        let list = rest.split(is_end).next().unwrap_or_default();
        list.split(is_between).map(str::to_owned).collect()
    };
    let named: Vec<String> = lines.join(" ").split("crate::").skip(1).flat_map(names).collect();
    UPDATE_MODULES[rank + 1..].iter().copied().filter(move |module| named.iter().any(|name| name == module))
}

fn check(package: &str, dependency: &str, kind: &str) -> Vec<String> {
    let metadata = format!(
        r#"{{"packages": [
            {{"name": "{package}", "dependencies": [{{"name": "{dependency}", "kind": {kind}}}]}},
            {{"name": "bvh-core", "dependencies": [{{"name": "glam", "kind": null}}]}},
            {{"name": "bvh-build", "dependencies": []}}
        ]}}"#
    );
    violations(&metadata)
}

#[test]
fn arrows_between_crates_go_one_way() {
    assert!(check("bvh-update", "bvh-core", "null").is_empty());
    assert_eq!(check("anim", "bvh-core", "null"), ["anim must not depend on bvh-core"]);
    assert_eq!(check("rt-cpu", "bvh-build", "null"), ["rt-cpu must not depend on bvh-build"]);
    assert!(check("rt-cpu", "bvh-build", "\"dev\"").is_empty());
    assert_eq!(check("newcomer", "glam", "null").len(), 1);
    let mut cargo = Command::new(env!("CARGO"));
    let cargo = cargo.args(["metadata", "--format-version", "1", "--no-deps"]).current_dir(workspace());
    let output = cargo.output().expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(violations(str::from_utf8(&output.stdout).expect("text")), Vec::<String>::new());
}

#[test]
fn modules_import_only_those_before_them() {
    let quality = UPDATE_MODULES.iter().position(|&m| m == "quality").unwrap();
    let against = |text: &str| imports_against(text, quality).collect::<Vec<_>>();
    assert!(against("use crate::refit::pass;\n/// See crate::auto.\n").is_empty());
    assert_eq!(against("use crate::refit::pass;\nuse crate::repair::{RepairScratch};\n"), ["repair"]);
    assert_eq!(against("use crate::{repair, refit};\n"), ["repair"]);
    assert_eq!(against("use crate::{\n    refit::{pass, plain},\n    repair,\n};\nauto(1, 2)"), ["repair"]);
    assert!(against("#[cfg(test)]\nmod tests {\n    use crate::auto::Auto;\n}").is_empty());
    let source = workspace().join("crates/bvh-update/src");
    assert_eq!(module_violations(&source), Vec::<String>::new());
    for module in UPDATE_MODULES {
        let file = source.join(module).with_extension("rs");
        assert!(file.exists() || source.join(module).is_dir(), "there is no {module}");
    }
    let unknown = module_violations(&workspace().join("xtask/src"));
    let line = "ci.rs is not in the list of modules in xtask/tests/layering.rs";
    assert!(unknown.iter().any(|violation| violation.ends_with(line)), "{unknown:?}");
}

#[test]
fn the_readme_names_the_test_command_of_ci() {
    for file in ["README.md", "xtask/src/ci.rs"] {
        let text = fs::read_to_string(workspace().join(file)).expect("text");
        assert!(text.contains("cargo test --workspace"), "{file} must name the test command");
    }
}
