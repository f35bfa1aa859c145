//! Which crate may depend on which, and which module on which: arrows go one way only. And the
//! README names the command that runs these tests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lab::files::workspace;
use serde_json::Value;

/// For each crate of the workspace, the others of the workspace that it may depend on.
const ALLOWED: [(&str, &[&str]); 19] = [
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
    ("pivot-allocations", &[]),
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
const ALLOWED_IN_TESTS: [(&str, &[&str]); 5] = [
    ("bvh-build", &["pivot-allocations"]),
    ("bvh-update", &["pivot-allocations"]),
    ("pivot-benches", &["pivot-tests"]),
    ("stage", &["pivot-allocations"]),
    ("viewer", &["lab"]),
];

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

/// The sources whose modules must not import one another in a circle.
const WITHOUT_CIRCLES: [&str; 6] = [
    "crates/bvh-core/src",
    "crates/bvh-build/src",
    "crates/rt-cpu/src",
    "crates/anim/src",
    "crates/scenes/src",
    "benches/src",
];

/// Imports that may close a circle.
const ALLOWED_IN_CIRCLES: [(&str, &str); 1] = [
    // `raw` has all unsafe code of `bvh-build`, and so the call of the search that is compiled for
    // AVX2; `neighbor_search` calls that.
    ("raw", "neighbor_search"),
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

/// The modules of a crate by their paths, the root's being empty, each with what it names outside of
/// tests and comments.
type Modules = BTreeMap<String, Vec<Name>>;

/// A path as it is written.
struct Name {
    path: Vec<String>,
    is_import: bool,
    is_export: bool,
}

/// The modules of a crate; `source` is its folder of sources.
fn modules(source: &Path) -> Modules {
    let mut modules = Modules::new();
    for file in rust_files(source) {
        let path = file.strip_prefix(source).expect("below it").with_extension("");
        let mut path: Vec<_> = path.iter().map(|name| name.to_string_lossy()).collect();
        path.pop_if(|name| ["lib", "main", "mod"].contains(&&**name));
        if !path.iter().any(|name| name == "tests") {
            modules.insert(path.join("::"), names(&fs::read_to_string(&file).expect("a source")));
        }
    }
    modules
}

/// All paths in a text, those in braces one by one.
fn names(text: &str) -> Vec<Name> {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let (mut names, mut path, mut before) = (Vec::new(), Vec::new(), "");
    let (mut is_import, mut is_export) = (false, false);
    // What stands before each brace that is open: the start of the paths in it.
    let mut open: Vec<Vec<String>> = Vec::new();
    for mut line in code.lines().map(str::trim_start).filter(|line| !line.starts_with("//")) {
        while let Some(first) = line.chars().next() {
            let is_between = |c: char| !c.is_alphanumeric() && c != '_';
            let length = match line.find(is_between) {
                Some(0) if line.starts_with("::") => 2,
                Some(0) => first.len_utf8(),
                word => word.unwrap_or(line.len()),
            };
            let (token, rest) = line.split_at(length);
            let goes_on = token == "::" && !before.ends_with(is_between) || before == "::" && token != "<";
            if !goes_on {
                let path = std::mem::take(&mut path);
                names.push(Name { path, is_import, is_export });
            }
            match token {
                "{" => open.push(std::mem::take(&mut path)),
                "}" => _ = open.pop(),
                "use" => (is_import, is_export) = (true, before == "pub" || before == ")"),
                ";" => (is_import, is_export) = (false, false),
                "::" => {}
                _ if goes_on => path.push(token.to_owned()),
                _ if is_between(first) || is_import && (token == "as" || before == "as") => {}
                _ => {
                    path = open.last().cloned().unwrap_or_default();
                    path.push(token.to_owned());
                }
            }
            (before, line) = (token, rest.trim_start());
        }
    }
    names
}

/// The module that has what `path` names in the module `from`, also if others export it; `None` if
/// that is in another crate.
fn home(modules: &Modules, from: &str, path: &[String]) -> Option<String> {
    let mut at: Vec<&str> = from.split("::").filter(|name| !name.is_empty()).collect();
    for (i, name) in path.iter().enumerate() {
        let here = at.join("::");
        at.push(name);
        match &name[..] {
            "crate" => at.clear(),
            "self" => _ = at.pop(),
            "super" => at.truncate(at.len() - 2),
            _ if modules.contains_key(&at.join("::")) => {}
            _ if i == 0 => return None,
            _ => {
                let mut imports = modules[&here].iter().filter(|n| n.is_import && n.path.len() > 1);
                let imported = imports.find(|import| import.path.last() == Some(name));
                return imported.map_or(Some(here.clone()), |import| home(modules, &here, &import.path));
            }
        }
    }
    Some(at.join("::"))
}

/// The modules that each module imports from; not those within it whose items it only exports.
fn imports(modules: &Modules) -> BTreeSet<(&str, String)> {
    let mut found = BTreeSet::new();
    for (from, names) in modules {
        for name in names.iter().filter(|name| name.path.len() > 1) {
            let Some(to) = home(modules, from, &name.path) else { continue };
            let below = to.strip_prefix(&from[..]).filter(|path| from.is_empty() || path.starts_with("::"));
            if to != *from && !(name.is_export && below.is_some()) {
                found.insert((&from[..], to));
            }
        }
    }
    found
}

/// Every import within `bvh-update` that goes against the order of its modules, and every module
/// that is not known here.
fn against_order(modules: &Modules) -> Vec<String> {
    let folder = |module: &str| module.split("::").next().unwrap_or_default().to_owned();
    let rank = |module: &str| UPDATE_MODULES.iter().position(|known| folder(module) == *known);
    let unknown = modules.keys().filter(|module| !module.is_empty() && rank(module).is_none());
    let unknown =
        unknown.map(|module| format!("{module} is not in the list of modules in xtask/tests/layering.rs"));
    // The root, which exports from all of them, is above them.
    let is_against =
        |from: &str, to: &str| rank(to).is_none_or(|to| rank(from).is_some_and(|from| to > from));
    let against = imports(modules).into_iter().filter(|(from, to)| !from.is_empty() && is_against(from, to));
    unknown.chain(against.map(|(from, to)| format!("{from} must not import {to}"))).collect()
}

/// Every import that is part of a circle, but for those `allowed`.
fn circles(modules: &Modules, allowed: &[(&str, &str)]) -> Vec<String> {
    let mut imports = imports(modules);
    imports.retain(|(from, to)| !allowed.contains(&(from, to)));
    let leads_back = |(from, to): &&(&str, String)| {
        let (mut reached, mut todo) = (BTreeSet::new(), vec![&to[..]]);
        while let Some(module) = todo.pop() {
            let next = imports.iter().filter(|(from, _)| *from == module).map(|(_, to)| &to[..]);
            todo.extend(next.filter(|to| reached.insert(*to)));
        }
        reached.contains(from)
    };
    imports.iter().filter(leads_back).map(|(from, to)| format!("{from} imports {to}")).collect()
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

fn check(package: &str, dependency: &str, kind: &str) -> Vec<String> {
    let metadata = format!(
        r#"{{"packages": [
            {{"name": "{package}", "dependencies": [{{"name": "{dependency}", "kind": {kind}}}]}},
            {{"name": "bvh-core", "dependencies": [{{"name": "glam", "kind": null}}]}},
            {{"name": "bvh-build", "dependencies": []}},
            {{"name": "lab", "dependencies": []}}
        ]}}"#
    );
    violations(&metadata)
}

#[test]
fn arrows_between_crates_go_one_way() {
    assert!(check("bvh-update", "bvh-core", "null").is_empty());
    assert_eq!(check("anim", "bvh-core", "null"), ["anim must not depend on bvh-core"]);
    assert_eq!(check("rt-cpu", "bvh-build", "null"), ["rt-cpu must not depend on bvh-build"]);
    assert_eq!(check("rt-cpu", "bvh-build", "\"dev\"").len(), 1);
    assert_eq!(check("viewer", "lab", "null"), ["viewer must not depend on lab"]);
    assert!(check("viewer", "lab", "\"dev\"").is_empty());
    assert_eq!(check("newcomer", "glam", "null").len(), 1);
    let mut cargo = Command::new(env!("CARGO"));
    let cargo = cargo.args(["metadata", "--format-version", "1", "--no-deps"]).current_dir(workspace());
    let output = cargo.output().expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(violations(str::from_utf8(&output.stdout).expect("text")), Vec::<String>::new());
}

/// Modules with these texts.
fn written(texts: &[(&str, &str)]) -> Modules {
    texts.iter().map(|&(module, text)| (module.to_owned(), names(text))).collect()
}

#[test]
fn modules_import_only_those_before_them() {
    let root = "mod auto;\npub use auto::{Auto, Load};\npub use bvh_build::Builder;\nmod refit;";
    let found = |text: &str| {
        let others = [("auto", ""), ("quality", ""), ("refit", ""), ("repair", ""), ("", root)];
        let mut modules = written(&others);
        modules.insert("quality::inner".to_owned(), names(text));
        against_order(&modules)
    };
    let against = ["quality::inner must not import repair"];
    assert!(found("use crate::refit::pass;\nuse crate::Builder;\n/// See crate::auto::Auto.\n").is_empty());
    assert!(found("use super::state;\nuse bvh_core::repair::Auto;").is_empty());
    assert_eq!(found("use crate::refit::pass;\nuse crate::repair::{RepairScratch};\n"), against);
    assert_eq!(found("use crate::{repair, refit};\n"), against);
    assert_eq!(found("use crate::{\n    refit::{pass, plain},\n    repair,\n};\nauto(1, 2)"), against);
    assert_eq!(found("pub(crate) use super::super::repair::top_tree;"), against);
    assert!(found("#[cfg(test)]\nmod tests {\n    use crate::auto::Auto;\n}").is_empty());
    // What the root exports is where it comes from.
    for text in ["use crate::Auto;", "use crate::{Builder, Load as Work};", "fn f(_: &crate::Auto) {}"] {
        assert_eq!(found(text), ["quality::inner must not import auto"], "{text}");
    }
    assert!(found("#[cfg(test)]\nmod tests {\n    use crate::Auto;\n}\n// crate::Auto").is_empty());

    let source = workspace().join("crates/bvh-update/src");
    assert_eq!(against_order(&modules(&source)), Vec::<String>::new());
    for module in UPDATE_MODULES {
        let file = source.join(module).with_extension("rs");
        assert!(file.exists() || source.join(module).is_dir(), "there is no {module}");
    }
    let unknown = against_order(&modules(&workspace().join("xtask/src")));
    let line = "ci is not in the list of modules in xtask/tests/layering.rs";
    assert!(unknown.iter().any(|violation| violation == line), "{unknown:?}");
}

#[test]
fn modules_do_not_import_one_another_in_a_circle() {
    let root = ("", "mod a;\nmod b;\nmod c;\npub use a::A;\npub use b::B;");
    let child = ("a::child", "use super::Shared;");
    let planted =
        written(&[root, ("a", "use crate::B;"), ("b", "use crate::c;"), ("c", "use crate::{A, B};")]);
    assert_eq!(circles(&planted, &[]), ["a imports b", "b imports c", "c imports a", "c imports b"]);
    assert_eq!(circles(&planted, &[("b", "c")]), Vec::<String>::new());
    let parent = "mod child;\nfn f() {\n    child::run();\n}";
    let found = circles(&written(&[root, ("a", parent), child]), &[]);
    assert_eq!(found, ["a imports a::child", "a::child imports a"]);
    let exports = "mod child;\npub(crate) use child::run;\nuse std::a::B;";
    let tests = "#[cfg(test)]\nmod tests {\n    use crate::A;\n}";
    assert!(circles(&written(&[root, ("a", exports), child, ("b", tests)]), &[]).is_empty());

    let mut all = BTreeSet::new();
    for folder in WITHOUT_CIRCLES {
        let modules = modules(&workspace().join(folder));
        assert_eq!(circles(&modules, &ALLOWED_IN_CIRCLES), Vec::<String>::new(), "{folder}");
        all.extend(circles(&modules, &[]));
    }
    for (from, to) in ALLOWED_IN_CIRCLES {
        assert!(all.contains(&format!("{from} imports {to}")), "{from} and {to} are no circle anymore");
    }
}

#[test]
fn the_readme_names_the_test_command_of_ci() {
    for file in ["README.md", "xtask/src/ci.rs"] {
        let text = fs::read_to_string(workspace().join(file)).expect("text");
        assert!(text.contains("cargo test --workspace"), "{file} must name the test command");
    }
}
