//! What is taken for many files that do not say it: values for all, for those of a format, or for
//! those of a folder.

use super::ReadOptions;
use crate::Result;
use crate::motion_format::MotionFormat;
use crate::pose::{LengthUnit, UpAxis};
use std::path::{Path, PathBuf};

/// What is taken for files that do not say it. Of several values that are for a file, that of the
/// deepest folder counts, else that of its format, else that of all files; of equals, the last.
///
/// ```
/// use posing_core::pose::UpAxis;
/// use posing_io::MotionFile;
/// use posing_io::motion_file::{ReadRules, Scope, Scoped};
///
/// // Of all files, y is up; of CSV files, z.
/// let y_up = Scoped { scope: Scope::All, value: UpAxis::Y };
/// let z_up = Scoped { scope: Scope::parse("csv")?, value: UpAxis::Z };
/// let rules = ReadRules { up: vec![y_up, z_up], ..ReadRules::default() };
/// # let folder = tempfile::tempdir()?;
/// let path = folder.path().join("hand.csv");
/// std::fs::write(&path, "hand.x,hand.y,hand.z\n1,2,3\n")?;
/// assert_eq!(MotionFile::open_by(&path, &rules)?.poses().xyz, ndarray::array![[1.0, 3.0, -2.0]]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct ReadRules {
    /// Frames per second.
    pub fps: Vec<Scoped<f64>>,
    /// The unit of length.
    pub units: Vec<Scoped<LengthUnit>>,
    /// The axis that points up.
    pub up: Vec<Scoped<UpAxis>>,
    /// What is the same for all files.
    pub all: ReadOptions,
}

impl ReadRules {
    /// What is taken for a file of this format.
    #[doc(hidden)]
    pub fn of(&self, path: &Path, format: MotionFormat) -> ReadOptions {
        ReadOptions {
            fps: Scoped::of(&self.fps, path, format).or(self.all.fps),
            units: Scoped::of(&self.units, path, format).or(self.all.units),
            up: Scoped::of(&self.up, path, format).or(self.all.up),
            ..self.all.clone()
        }
    }
}

/// The words for formats: the last word of each format's name, or all of it.
const FORMATS: [&str; 14] = [
    "c3d",
    "trc",
    "bvh",
    "fbx",
    "amc",
    "csv",
    "tsv",
    "npy",
    "npz",
    "json",
    "motive-csv",
    "points-csv",
    "qualisys-tsv",
    "vicon-nexus-csv",
];

/// A value, and the files that it is for.
#[derive(Debug, Clone, PartialEq)]
pub struct Scoped<T> {
    /// The files.
    pub scope: Scope,
    /// The value.
    pub value: T,
}

/// Some of many files.
#[derive(Debug, Clone, PartialEq)]
pub enum Scope {
    /// All files.
    All,
    /// Those of a format, by the last word of its name or all of it, in small letters: `csv`,
    /// `motive-csv`.
    Format(String),
    /// Those in a folder and below it, without links.
    Folder(PathBuf),
}

impl Scope {
    /// `c3d`, or the path of a folder.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: it is neither.
    pub fn parse(word: &str) -> Result<Scope> {
        let format = word.to_ascii_lowercase();
        if FORMATS.contains(&format.as_str()) {
            return Ok(Scope::Format(format));
        }
        match Path::new(word).canonicalize() {
            Ok(folder) if folder.is_dir() => Ok(Scope::Folder(folder)),
            _ => Err(format!(
                "\"{word}\" is neither a format ({}) nor a folder",
                FORMATS.join(", ")
            )
            .into()),
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
    /// The value for a file: that of the deepest folder which holds it, else that of its format,
    /// else that of all files; of equals, the last.
    pub(crate) fn of(all: &[Scoped<T>], path: &Path, format: MotionFormat) -> Option<T> {
        let ranked = all.iter().enumerate().filter_map(|(i, scoped)| {
            let rank = scoped.scope.rank(path, format)?;
            Some(((rank, i), scoped.value))
        });
        ranked.max_by_key(|(rank, _)| *rank).map(|(_, value)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_comes_before_a_format_before_all() -> std::io::Result<()> {
        let base = tempfile::tempdir()?;
        let at = |name: &str| base.path().join(name);
        std::fs::create_dir_all(at("lab/day"))?;
        let folder = |name: &str| Scope::parse(at(name).to_str().unwrap()).unwrap();
        let format = |name: &str| Scope::parse(name).unwrap();
        let all = [
            (Scope::All, UpAxis::Z),
            (format("c3d"), UpAxis::Y),
            (folder("lab"), UpAxis::X),
            (format("motive-csv"), UpAxis::X),
            (folder("lab/day"), UpAxis::Y),
            (format("CSV"), UpAxis::Y),
        ]
        .map(|(scope, value)| Scoped { scope, value });
        let of = |path: PathBuf, format| Scoped::of(&all, &path, format);
        assert_eq!(of(at("a.trc"), MotionFormat::Trc), Some(UpAxis::Z));
        assert_eq!(of(at("a.c3d"), MotionFormat::C3d), Some(UpAxis::Y));
        assert_eq!(of(at("lab/a.c3d"), MotionFormat::C3d), Some(UpAxis::X));
        assert_eq!(of(at("lab/day/a.c3d"), MotionFormat::C3d), Some(UpAxis::Y));
        assert_eq!(of(at("a.csv"), MotionFormat::MotiveCsv), Some(UpAxis::Y));
        assert_eq!(of(PathBuf::from("-"), MotionFormat::Csv), Some(UpAxis::Y));
        assert_eq!(
            Scoped::of(&all[3..4], Path::new("a"), MotionFormat::Csv),
            None
        );
        for bad in ["c4d", ""] {
            assert!(Scope::parse(bad).is_err(), "{bad}");
        }
        Ok(())
    }
}
