//! `plot` around the library: pose tables with statuses, bones by name, a table of text, the flags
//! of an SVG.

use super::point_columns::{PointColumns, PointColumnsReader};
use posing::cli::args::InputArgs;
use posing::cli::fbx_choice::FbxChoiceArgs;
use posing::cli::input::{RowStream, open};
use posing::cli::messages;
use posing::draw::figure::{self, Layout};
use posing::draw::scene::{Scene, Table, spread};
use posing::evaluate::alignment::point_order;
use posing::io::csv::csv_fault;
use posing::io::motion_file::{ReadOptions, skeleton_of};
use posing::io::{MotionFile, MotionFormat, PosesBuilder, Row};
use posing::pose::{Poses, joints};
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// A table of text is small.
const TABLE_LIMIT: u64 = 1 << 20;

/// Frames that are drawn by default.
const SPREAD: usize = 6;
/// The largest number of frames in an SVG that viewers still open.
const MOST_DRAWN: usize = 500;

/// The format of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
pub enum PlotFormat {
    /// Picture of some frames
    Svg,
    /// Self-contained page that plays all frames
    Html,
}

/// The flags of an SVG.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "SVG")]
pub struct SvgArgs {
    /// Comma-separated frames to draw, counted from 0 (default: six, evenly spaced)
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub frames: Vec<usize>,
    /// Draw the figures on top of each other, as two takes are; =false: below each other
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        conflicts_with = "trail"
    )]
    pub overlaid: Option<bool>,
    /// Draw all frames in one panel, at their positions in the world
    #[arg(long)]
    pub trail: bool,
    /// Direction of the viewer, in degrees: 0 at +z, 90 at +x (default: the figure's side; of
    /// meshes, 0)
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    pub azimuth: Option<f64>,
    /// Angle at which the viewer looks down, in degrees (default: 12)
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    pub elevation: Option<f64>,
}

impl SvgArgs {
    /// The first of these flags that is given.
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            ("--frames", !self.frames.is_empty()),
            ("--overlaid", self.overlaid.is_some()),
            ("--trail", self.trail),
            ("--azimuth", self.azimuth.is_some()),
            ("--elevation", self.elevation.is_some()),
        ];
        all.into_iter()
            .find_map(|(flag, given)| given.then_some(flag))
    }

    /// Draws the frames of `--frames`, or every few, or six.
    ///
    /// # Errors
    /// Usage: too many frames, or as [`figure::svg`].
    pub fn draw(&self, scene: &Scene<'_>, every: Option<usize>) -> Result<String> {
        let frames = self.chosen(scene.frames(), every)?;
        let mut options = self.options();
        if scene.pair.is_some() && self.overlaid.is_none() && !self.trail {
            options.layout = Layout::Overlaid;
        }
        figure::svg(scene, &frames, &options)
    }

    /// The frames of `--frames`, or every few of `count`, or six.
    ///
    /// # Errors
    /// Usage: more than viewers still open.
    pub fn chosen(&self, count: usize, every: Option<usize>) -> Result<Vec<usize>> {
        let frames = match every {
            Some(0) => return Err(Error::usage("--every 0: must be at least 1")),
            Some(every) => (0..count).step_by(every).collect(),
            None if self.frames.is_empty() => spread(count, SPREAD),
            None => self.frames.clone(),
        };
        if frames.len() > MOST_DRAWN {
            let what = format!(
                "{} frames in one SVG; at most {MOST_DRAWN} are possible, see --every",
                frames.len()
            );
            return Err(Error::usage(what));
        }
        Ok(frames)
    }

    /// The options of the library.
    pub fn options(&self) -> figure::Options {
        let defaults = figure::Options::default();
        figure::Options {
            layout: match (self.overlaid, self.trail) {
                (Some(true), _) => Layout::Overlaid,
                (_, true) => Layout::Trail,
                _ => Layout::Grid,
            },
            azimuth: self.azimuth,
            elevation: self.elevation.unwrap_or(defaults.elevation),
        }
    }
}

/// A pose table as it is drawn.
pub struct PlotTable {
    /// What messages call it.
    pub file: String,
    /// Its poses.
    pub poses: Poses,
    /// What its columns of `--status` say.
    pub columns: PointColumns,
    /// The pairs of points that a skeleton joins, where the file has one.
    pub bones: Option<Vec<(usize, usize)>>,
    /// Frames a second, where the file says so.
    pub rate: Option<f64>,
    /// Whether its times are those of a clock, and do not merely count from its start.
    pub is_clocked: bool,
}

impl PlotTable {
    /// Reads tables and files of motion. One or two may be any; more must have the same points,
    /// frames, takes and times.
    ///
    /// # Errors
    /// Data: a file is no table, has no frames, or is one of more than two and differs from the
    /// first.
    pub fn read_all(
        flags: &InputArgs,
        files: &[PathBuf],
        fbx: &FbxChoiceArgs,
    ) -> Result<Vec<PlotTable>> {
        let mut tables: Vec<PlotTable> = Vec::new();
        for file in files {
            let mut table = if is_motion_file(file)? {
                PlotTable::of_motion(file, flags, fbx)?
            } else {
                PlotTable::read(&flags.with_files(vec![file.clone()]))?
            };
            if let Some(first) = tables.first().filter(|_| files.len() > 2) {
                table.match_to(first)?;
            }
            tables.push(table);
        }
        Ok(tables)
    }

    /// The points of a file of motion.
    fn of_motion(path: &Path, flags: &InputArgs, fbx: &FbxChoiceArgs) -> Result<PlotTable> {
        let options = fbx.chosen(ReadOptions {
            fps: flags.fps,
            units: flags.units,
            ..flags.axes.options()
        });
        let name = path.display().to_string();
        if format_of(path)? == MotionFormat::Amc && skeleton_of(path, &options).is_err() {
            let what = "has no ASF file beside it whose name begins its own: copy its skeleton \
                        there, or convert it with amc2xyz --asf SUBJECT.asf";
            return Err(Error::data(Place::file(name), what));
        }
        let file = MotionFile::open(path, &options)?;
        file.notes
            .iter()
            .for_each(|note| messages::info(&format!("{name}: {note}")));
        if file.poses().frames() == 0 {
            return Err(Error::data(Place::file(name), "has no frames to draw"));
        }
        Ok(PlotTable {
            rate: file.rate(),
            is_clocked: file.motion().is_none(),
            bones: Some(file.bones()?),
            poses: Poses {
                take: None,
                ..file.poses().clone()
            },
            columns: PointColumns::default(),
            file: name,
        })
    }

    /// Reads the table of one file, or of standard input.
    fn read(input: &InputArgs) -> Result<PlotTable> {
        let mut stream = RowStream::open(input, true, true)?;
        let columns = stream.columns().clone();
        let file = stream.name().to_string();
        let (mut builder, mut row) = (PosesBuilder::new(&columns), Row::default());
        let mut of_points =
            PointColumnsReader::new(&columns, input.table_units().unit.centimeters());
        while stream.read(&mut row)? {
            builder.push(&row);
            of_points.push(&file, &row)?;
        }
        let poses = builder.finish();
        if poses.frames() == 0 {
            return Err(Error::data(Place::file(file), "has no frames to draw"));
        }
        Ok(PlotTable {
            rate: None,
            is_clocked: poses.time.is_some(),
            file,
            poses,
            columns: of_points.finish(),
            bones: None,
        })
    }

    /// Puts the points in the order of `first`.
    fn match_to(&mut self, first: &PlotTable) -> Result<()> {
        let order = point_order(&first.poses, &self.poses);
        let order = order.and_then(|order| {
            if order.len() == self.poses.points.len() {
                Ok(order)
            } else {
                Err("has more points".into())
            }
        });
        let order = order.map_err(|what| {
            let rule = "of more than two takes, all must have the same points and frames";
            let what = format!("{what} as in {}; {rule}", first.file);
            Error::data(Place::file(&self.file), what)
        })?;
        let columns: Vec<usize> = order.iter().flat_map(|&p| 3 * p..3 * p + 3).collect();
        self.poses.xyz = self.poses.xyz.select(ndarray::Axis(1), &columns);
        self.columns = self.columns.select(&order);
        self.poses.points.clone_from(&first.poses.points);
        Ok(())
    }
}

/// Whether a file is one of motion, and no pose table.
fn is_motion_file(path: &Path) -> Result<bool> {
    Ok(path != Path::new("-")
        && matches!(
            format_of(path)?,
            MotionFormat::Bvh
                | MotionFormat::Fbx
                | MotionFormat::C3d
                | MotionFormat::Trc
                | MotionFormat::Amc
                | MotionFormat::MotiveCsv
                | MotionFormat::QualisysTsv
                | MotionFormat::NexusCsv
                | MotionFormat::PointTable
                | MotionFormat::LongTable
                | MotionFormat::Keypoints
        ))
}

/// The format that a file's first lines tell.
fn format_of(path: &Path) -> Result<MotionFormat> {
    let mut input = open(path)?;
    input.look_ahead()?;
    Ok(MotionFormat::of(input.first_bytes()))
}

/// The pairs of points to join: those of a list such as `a-b,c-d`, by default those of
/// [`joints::bones`].
pub fn bones(list: Option<&str>, points: &[String]) -> Result<Vec<(usize, usize)>> {
    let Some(list) = list else {
        return Ok(joints::bones(points));
    };
    let find = |name: &str| points.iter().position(|p| p == name);
    let bone = |pair: &str| {
        // A point's own name may hold a hyphen: each is tried as the one between the two.
        pair.match_indices('-')
            .find_map(|(at, _)| Some((find(&pair[..at])?, find(&pair[at + 1..])?)))
            .ok_or_else(|| {
                let what = "is not a pair of the table's points such as head-neck";
                Error::usage(format!("--bones: \"{pair}\" {what}"))
            })
    };
    list.split(',').map(|pair| bone(pair.trim())).collect()
}

/// Reads a small CSV file that is shown as it is.
pub fn text_table(path: &Path, caption: &str) -> Result<Table> {
    let input = open(path)?;
    let name = input.name.clone();
    let bytes = input.read_all(TABLE_LIMIT)?;
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    let fail = |e: csv::Error| csv_fault(&name, &e);
    let cells = |record: &csv::StringRecord| record.iter().map(String::from).collect();
    let header = cells(reader.headers().map_err(fail)?);
    let mut rows = Vec::new();
    for record in reader.records() {
        rows.push(cells(&record.map_err(fail)?));
    }
    Ok(Table {
        caption: caption.into(),
        header,
        rows,
        links: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(list: &[&str]) -> Vec<String> {
        list.iter().map(|s| s.to_string()).collect()
    }

    #[test]
    fn bones_by_name_or_as_said() {
        let names = points(&["root", "lfemur", "a-b"]);
        assert_eq!(bones(None, &names).unwrap(), [(0, 1)]);
        let said = bones(Some("root-a-b, a-b-lfemur"), &names).unwrap();
        assert_eq!(said, [(0, 2), (2, 1)]);
        for bad in ["", "root", "root-x", "root-lfemur,"] {
            assert_eq!(bones(Some(bad), &names).unwrap_err().exit_code(), 2);
        }
    }
}
