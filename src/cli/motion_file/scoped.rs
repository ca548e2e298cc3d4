//! Values of a flag for all files, for those of a format, or for those of a folder.

use crate::cli::args::parse_rate;
use crate::cli::units::{Units, Up};
use crate::io::MotionFormat;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// The words for formats: the last word of each format's name, or all of it.
const FORMATS: [&str; 12] = [
    "c3d",
    "trc",
    "bvh",
    "amc",
    "csv",
    "tsv",
    "npy",
    "npz",
    "motive-csv",
    "points-csv",
    "qualisys-tsv",
    "vicon-nexus-csv",
];

/// A value, and the files that it is for.
#[derive(Debug, Clone, PartialEq)]
pub struct Scoped<T> {
    scope: Scope,
    value: T,
}

#[derive(Debug, Clone, PartialEq)]
enum Scope {
    All,
    Format(String),
    Folder(PathBuf),
}

impl Scope {
    /// `c3d`, or the path of a folder.
    fn parse(word: &str) -> Result<Scope, String> {
        let format = word.to_ascii_lowercase();
        if FORMATS.contains(&format.as_str()) {
            return Ok(Scope::Format(format));
        }
        match Path::new(word).canonicalize() {
            Ok(folder) if folder.is_dir() => Ok(Scope::Folder(folder)),
            _ => Err(format!(
                "\"{word}\" is neither a format ({}) nor a folder",
                FORMATS.join(", ")
            )),
        }
    }

    /// How closely it names a file; `None`: not at all.
    fn rank(&self, path: &Path, format: MotionFormat) -> Option<usize> {
        match self {
            Scope::All => Some(0),
            Scope::Format(word) => {
                let name = format.name().to_ascii_lowercase();
                let is_it =
                    name.split(' ').next_back() == Some(word) || name.replace(' ', "-") == *word;
                is_it.then_some(1)
            }
            Scope::Folder(folder) => {
                let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
                let parent = parent.unwrap_or(Path::new(".")).canonicalize().ok()?;
                (path != Path::new("-") && parent.starts_with(folder))
                    .then(|| 2 + folder.components().count())
            }
        }
    }
}

impl<T: Copy> Scoped<T> {
    /// `VALUE`, or `c3d=VALUE`, or `captures/lab1=VALUE`.
    fn parse(text: &str, value: impl Fn(&str) -> Result<T, String>) -> Result<Scoped<T>, String> {
        let (scope, text) = match text.rsplit_once('=') {
            Some((word, text)) => (Scope::parse(word)?, text),
            None => (Scope::All, text),
        };
        let value = value(text)?;
        Ok(Scoped { scope, value })
    }

    /// The value for a file: that of the deepest folder which holds it, else that of its format, else that of all files; of equals, the
    /// last.
    pub fn of(all: &[Scoped<T>], path: &Path, format: MotionFormat) -> Option<T> {
        let ranked = all.iter().enumerate().filter_map(|(i, scoped)| {
            let rank = scoped.scope.rank(path, format)?;
            Some(((rank, i), scoped.value))
        });
        ranked.max_by_key(|(rank, _)| *rank).map(|(_, value)| value)
    }
}

/// `--fps`.
pub fn parse_scoped_rate(text: &str) -> Result<Scoped<f64>, String> {
    Scoped::parse(text, parse_rate)
}

/// `--units`.
pub fn parse_scoped_units(text: &str) -> Result<Scoped<Units>, String> {
    let expected = |_| "expected cm, m, mm, in or asf".to_string();
    Scoped::parse(text, |text| Units::from_str(text, true).map_err(expected))
}

/// `--up`.
pub fn parse_scoped_up(text: &str) -> Result<Scoped<Up>, String> {
    let expected = |_| "expected x, y or z".to_string();
    Scoped::parse(text, |text| Up::from_str(text, true).map_err(expected))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_comes_before_a_format_before_all() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("lab/day"))?;
        let lab = format!("{}=x", at("lab").display());
        let day = format!("{}=y", at("lab/day").display());
        let all: Vec<Scoped<Up>> = ["z", "c3d=y", &lab, "motive-csv=x", &day, "CSV=y"]
            .into_iter()
            .map(|text| parse_scoped_up(text).unwrap())
            .collect();
        let of = |path: PathBuf, format| Scoped::of(&all, &path, format);
        assert_eq!(of(at("a.trc"), MotionFormat::Trc), Some(Up::Z));
        assert_eq!(of(at("a.c3d"), MotionFormat::C3d), Some(Up::Y));
        assert_eq!(of(at("lab/a.c3d"), MotionFormat::C3d), Some(Up::X));
        assert_eq!(of(at("lab/day/a.c3d"), MotionFormat::C3d), Some(Up::Y));
        assert_eq!(of(at("a.csv"), MotionFormat::MotiveCsv), Some(Up::Y));
        assert_eq!(of(PathBuf::from("-"), MotionFormat::Csv), Some(Up::Y));
        assert_eq!(
            Scoped::of(&all[3..4], Path::new("a"), MotionFormat::Csv),
            None
        );
        for bad in ["w", "c3d=w", "c4d=z", "=z", "c3d="] {
            assert!(parse_scoped_up(bad).is_err(), "{bad}");
        }
        Ok(())
    }
}
