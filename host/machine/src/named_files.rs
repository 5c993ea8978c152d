//! Lists the existing files that a description names in any field, and those that these name in
//! turn where they are TOML, for checksums, archives and the protection of inputs from being
//! overwritten.

use std::path::{Path, PathBuf};

use toml::Value;

use loadtwin_files::bounded;

/// Levels of descriptions that name one another.
const DEPTH: usize = 4;

/// Every file that the description in `path` names, in whichever field, and
/// those that these name, where they are TOML; files that are not there are
/// left out, and so is a description that cannot be read.
pub fn named_files(path: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    collect(path, DEPTH, &mut found);
    found
}

fn collect(path: &Path, depth: usize, found: &mut Vec<PathBuf>) {
    let Some(depth) = depth.checked_sub(1) else {
        return;
    };
    let text = bounded::read_text(path, bounded::DESCRIPTION).unwrap_or_default();
    let mut open: Vec<Value> = toml::from_str(&text).into_iter().collect();
    while let Some(value) = open.pop() {
        match value {
            Value::Table(table) => open.extend(table.into_iter().map(|(_, value)| value)),
            Value::Array(values) => open.extend(values),
            Value::String(text) => {
                let named = path.parent().unwrap_or(Path::new("")).join(text);
                if named.is_file() && !found.contains(&named) {
                    let is_toml = named.extension().is_some_and(|end| end == "toml");
                    found.push(named.clone());
                    if is_toml {
                        collect(&named, depth, found);
                    }
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_found_in_any_field_and_in_files_named() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(
            at("machine.toml"),
            "a = 'layout.toml'\nb = 'absent.csv'\n[[c]]\nd = ['map.csv']\n",
        )
        .unwrap();
        std::fs::write(
            at("layout.toml"),
            "back = 'machine.toml'\ne = 'names.csv'\n",
        )
        .unwrap();
        std::fs::write(at("map.csv"), "").unwrap();
        std::fs::write(at("names.csv"), "").unwrap();
        let mut found = named_files(&at("machine.toml"));
        found.sort();
        assert_eq!(
            found,
            ["layout.toml", "machine.toml", "map.csv", "names.csv"].map(at)
        );
        assert!(named_files(&at("absent.toml")).is_empty());
    }
}
