//! Paths and links from a folder, or a page in it, to other files.

use std::fmt::Write;
use std::path::{Component, Path, PathBuf};

/// The address of the file `to` from a page in `folder`.
pub fn href(folder: &Path, to: &Path) -> String {
    let path = relative(folder, to);
    let parts: Vec<String> = path.split('/').map(encoded).collect();
    parts.join("/")
}

/// The path of the file `to` from `folder`, with slashes.
pub fn relative(folder: &Path, to: &Path) -> String {
    let own = absolute(folder);
    let parent = to.parent().map(absolute).unwrap_or_default();
    let shared = own
        .components()
        .zip(parent.components())
        .take_while(|(a, b)| a == b)
        .count();
    let ups = own.components().skip(shared).map(|_| "..".to_string());
    let downs = parent.components().skip(shared);
    let names = downs.filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    });
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    let parts: Vec<String> = ups.chain(names).chain([name.into_owned()]).collect();
    parts.join("/")
}

/// The path of a folder without links, where it exists.
fn absolute(folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    folder.canonicalize().unwrap_or(folder.to_path_buf())
}

/// Text as a part of an address: all but letters, digits and `-_.~` as %XX.
pub fn encoded(text: &str) -> String {
    let mut out = String::new();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte) {
            out.push(byte as char)
        } else {
            // Writing to memory cannot fail.
            let _ = write!(out, "%{byte:02X}");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_from_folder_to_folder() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("a/b"))?;
        std::fs::create_dir_all(at("c"))?;
        assert_eq!(href(&at("a"), &at("a/b/x y.c3d.html")), "b/x%20y.c3d.html");
        assert_eq!(
            href(&at("c"), &at("a/b/é#1'.csv")),
            "../a/b/%C3%A9%231%27.csv"
        );
        assert_eq!(href(&at("a/b"), &at("a/b/z")), "z");
        assert_eq!(relative(&at("c"), &at("a/b/é#.csv")), "../a/b/é#.csv");
        Ok(())
    }
}
