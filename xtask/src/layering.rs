//! Which crate may depend on which; arrows go one way only.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use serde::Deserialize;

/// For each crate of the workspace, the others of the workspace that it may depend on.
const ALLOWED: [(&str, &[&str]); 13] = [
    ("bvh-core", &[]),
    ("bvh-build", &["bvh-core"]),
    ("bvh-update", &["bvh-core", "bvh-build"]),
    ("pivot-bvh", &["bvh-core", "bvh-build", "bvh-update"]),
    ("rt-cpu", &["bvh-core"]),
    ("anim", &[]),
    ("scenes", &["anim"]),
    ("lab", &["bvh-core", "bvh-build", "bvh-update", "rt-cpu", "anim", "scenes", "pivot-benches"]),
    ("xtask", &["lab"]),
    ("pivot-tests", LIBRARIES),
    ("pivot-fingerprints", LIBRARIES),
    ("pivot-benches", LIBRARIES),
    ("pivot-examples", LIBRARIES),
];

const LIBRARIES: &[&str] = &["bvh-core", "bvh-build", "bvh-update", "pivot-bvh", "rt-cpu", "anim", "scenes"];

/// Dependencies that a crate may have for its tests alone, beyond those.
const ALLOWED_IN_TESTS: [(&str, &[&str]); 1] = [("rt-cpu", &["bvh-build"])];

/// The part of `cargo metadata` that is read here.
#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    /// `None` for an ordinary dependency.
    kind: Option<String>,
}

/// Every edge between crates of the workspace that is not allowed, and every crate that is not
/// known here.
pub(crate) fn violations(metadata: &str) -> Result<Vec<String>> {
    let metadata: Metadata =
        serde_json::from_str(metadata).context("cargo metadata printed something unexpected")?;
    let members: Vec<&str> = metadata.packages.iter().map(|p| p.name.as_str()).collect();
    let (allowed, in_tests) = (BTreeMap::from(ALLOWED), BTreeMap::from(ALLOWED_IN_TESTS));
    let mut found = Vec::new();
    for package in &metadata.packages {
        let name = package.name.as_str();
        let Some(may) = allowed.get(name) else {
            found.push(format!("{name} is not in the list of crates in xtask/src/layering.rs"));
            continue;
        };
        for dependency in &package.dependencies {
            let to = dependency.name.as_str();
            let for_tests = dependency.kind.as_deref() == Some("dev")
                && in_tests.get(name).is_some_and(|names| names.contains(&to));
            if members.contains(&to) && !may.contains(&to) && !for_tests {
                found.push(format!("{name} must not depend on {to}"));
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(package: &str, dependency: &str, kind: &str) -> Vec<String> {
        let metadata = format!(
            r#"{{"packages": [
                {{"name": "{package}", "dependencies": [{{"name": "{dependency}", "kind": {kind}}}]}},
                {{"name": "bvh-core", "dependencies": [{{"name": "glam", "kind": null}}]}},
                {{"name": "bvh-build", "dependencies": []}}
            ]}}"#
        );
        violations(&metadata).unwrap()
    }

    #[test]
    fn arrows_go_one_way() {
        assert!(check("bvh-update", "bvh-core", "null").is_empty());
        assert_eq!(check("anim", "bvh-core", "null"), ["anim must not depend on bvh-core"]);
        assert_eq!(check("rt-cpu", "bvh-build", "null"), ["rt-cpu must not depend on bvh-build"]);
        assert!(check("rt-cpu", "bvh-build", "\"dev\"").is_empty());
        assert_eq!(check("newcomer", "glam", "null").len(), 1);
        assert!(violations("{}").is_err());
    }
}
