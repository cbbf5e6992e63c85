//! The rooms of `src/` name each other in one direction only.

use std::{
    collections::HashSet,
    fs,
    path::{Path, PathBuf},
};

/// Each room, and whom it may name.
const LAYERS: [(&str, &[&str]); 8] = [
    ("geometry", &[]),
    ("debug", &[]),
    ("config", &["geometry"]),
    ("plan", &["config", "geometry"]),
    ("support", &["config"]),
    ("systems", &["plan", "config", "support", "geometry"]),
    ("shaders", &["config", "debug", "support", "geometry"]),
    (
        "render",
        &[
            "systems", "plan", "config", "support", "shaders", "debug", "geometry",
        ],
    ),
];

fn files_in(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files_in(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Names that stand right after `crate::`, alone or in braces, outside comments.
fn named_rooms(text: &str) -> HashSet<String> {
    let code: Vec<&str> = text
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .collect();
    let code = code.join("\n");
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let name = |text: &str| {
        text.trim_start()
            .chars()
            .take_while(|c| is_name(*c))
            .collect()
    };
    let mut found = HashSet::new();
    for rest in code.split("crate::").skip(1) {
        let Some(list) = rest.strip_prefix('{') else {
            found.insert(name(rest));
            continue;
        };
        let mut depth = 1;
        let mut start = true;
        for (index, letter) in list.char_indices() {
            if depth == 1 && start && is_name(letter) {
                found.insert(name(&list[index..]));
                start = false;
            }
            match letter {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => start = true,
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }
    found
}

/// What a file of a room names that it must not.
fn forbidden(room: &str, text: &str) -> Vec<String> {
    let (_, allowed) = LAYERS
        .iter()
        .find(|(name, _)| *name == room)
        .unwrap_or_else(|| panic!("{room} is no room"));
    let mut names = named_rooms(text);
    names.remove(room);
    names.retain(|name| !allowed.contains(&name.as_str()));
    let mut names: Vec<String> = names.into_iter().collect();
    names.sort();
    if text.contains("super::super") {
        names.push("super::super".to_owned());
    }
    names
}

#[test]
fn rooms_name_each_other_in_one_direction() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    files_in(&source, &mut files);
    let mut rooms = HashSet::new();
    for file in files {
        let path = file.strip_prefix(&source).expect("in src");
        let first = path.iter().next().expect("a name").to_string_lossy();
        let room = first.trim_end_matches(".rs");
        let text = fs::read_to_string(&file).expect("text");
        if room == "lib" {
            continue;
        }
        let names = forbidden(room, &text);
        assert!(names.is_empty(), "{} names {names:?}", path.display());
        rooms.insert(room.to_owned());
    }
    assert_eq!(rooms.len(), LAYERS.len());
}

#[test]
fn forbidden_arrows_are_found() {
    for (room, text) in [
        ("geometry", "use crate::config::SplitScheme;"),
        (
            "config",
            "use crate::{\n    geometry::bias,\n    systems::ManagedLight,\n};",
        ),
        ("plan", "fn f() -> crate::render::ShadowTarget {}"),
        ("support", "use crate::{config::{MAX, MIN}, systems};"),
        ("systems", "use crate::{plan::{a, b}, render::c};"),
        ("shaders", "use crate::plan::filter_of;"),
        ("plan", "use crate::ShaderFeatures;"),
        ("geometry", "use super::super::config::MapWarp;"),
    ] {
        assert_eq!(forbidden(room, text).len(), 1, "{room}: {text}");
    }
    let comment = "/// See [`crate::render`].\nuse crate::{config::{render, X}, plan};";
    assert!(forbidden("systems", comment).is_empty());
}
