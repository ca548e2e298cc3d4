//! `plot` around the library, for meshes: flags, the scene, the rows of a picture.

use super::tables::{PlotFormat, SvgArgs};
use clap::parser::ValueSource;
use posing::cli::args::InputArgs;
use posing::draw::figure::mesh::{Row, Still, svg};
use posing::draw::mesh_scene::MeshScene;
use posing::draw::mesh_sequences::{MeshFiles, Sequence};
use posing::draw::player::mesh::page;
use posing::draw::scene::Table;
use posing::{Error, Result};

/// The largest number of meshes in a row of an SVG, some 10 MB of bodies.
const MOST_STILLS: usize = 100;

/// The flags of meshes.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Meshes")]
pub struct MeshArgs {
    /// Comma-separated arrays of an NPZ file to draw, such as predicted; each is a figure
    /// (default: vertices; of body-fit's files, completed)
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub array: Vec<String>,
}

/// Whether `--units` is typed. Stands before the flags that it looks at: they are taken out of the
/// matches when they are read.
#[derive(Debug, Clone, Copy)]
pub struct UnitsTyped(pub bool);

impl clap::FromArgMatches for UnitsTyped {
    fn from_arg_matches(matches: &clap::ArgMatches) -> std::result::Result<Self, clap::Error> {
        let source = matches.value_source("units");
        Ok(UnitsTyped(source == Some(ValueSource::CommandLine)))
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &clap::ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl clap::Args for UnitsTyped {
    fn augment_args(command: clap::Command) -> clap::Command {
        command
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        command
    }
}

/// All that is drawn of meshes.
pub struct MeshPlot<'a> {
    /// The flags of the input: files, unit, axis, rate.
    pub input: &'a InputArgs,
    /// Whether `--units` is typed; otherwise only files of `body-fit` have a unit.
    pub units_typed: bool,
    /// The flags of meshes.
    pub meshes: &'a MeshArgs,
    /// The flags of an SVG.
    pub svg: &'a SvgArgs,
    /// The names of the figures; without any, those of the files.
    pub names: &'a [String],
    /// One frame of every so many.
    pub every: Option<usize>,
    /// The heading.
    pub title: &'a str,
    /// A sentence below the heading.
    pub note: Option<&'a str>,
    /// The credit line.
    pub credit: Option<&'a str>,
}

impl MeshPlot<'_> {
    /// The drawing.
    ///
    /// # Errors
    /// Those of reading meshes, of [`svg`] and of [`page`]; usage: a flag that does not fit meshes,
    /// names that are not as many as the figures.
    pub fn draw(&self, to: PlotFormat, table: Option<Table>) -> Result<String> {
        self.check_flags()?;
        let files = MeshFiles {
            files: &self.input.files,
            arrays: &self.meshes.array,
            units: self.input.table_units(),
            // A picture shows meshes of any topology side by side.
            one_topology: to == PlotFormat::Html,
        };
        let mut sequences = files.read()?;
        match self.names.len() {
            0 => {}
            count if count == sequences.len() => {
                for (sequence, name) in sequences.iter_mut().zip(self.names) {
                    sequence.name.clone_from(name);
                }
            }
            count => {
                let what = format!("--names has {count} names for {} figures", sequences.len());
                return Err(Error::usage(what));
            }
        }
        let figures = sequences.iter().flat_map(Sequence::figures).collect();
        let scene = MeshScene {
            title: self.title,
            figures,
            rate: self.input.fps,
            in_cm: self.units_typed || sequences.iter().all(|s| s.in_cm),
            note: self.note,
            table,
            credit: self.credit,
        };
        match to {
            PlotFormat::Html => page(&scene, self.every),
            PlotFormat::Svg => {
                let rows = self.rows(&sequences, &scene)?;
                svg(&scene, &rows, &self.svg.options())
            }
        }
    }

    /// Refuses flags of tables.
    fn check_flags(&self) -> Result<()> {
        let flags = [
            ("--joints", self.input.joints.is_some()),
            ("--overlaid", self.svg.overlaid.is_some()),
            ("--trail", self.svg.trail),
        ];
        match flags.iter().find(|(_, given)| *given) {
            Some((flag, _)) => Err(Error::usage(format!("{flag} is for tables only"))),
            None => Ok(()),
        }
    }

    /// The rows of a picture: one of each sequence, of those of its frames that are drawn.
    fn rows(&self, sequences: &[Sequence], scene: &MeshScene<'_>) -> Result<Vec<Row>> {
        let (mut rows, mut figure) = (Vec::new(), 0);
        for sequence in sequences {
            let each =
                sequence.sets.iter().enumerate().flat_map(|(i, set)| {
                    (0..set.names.len()).map(move |frame| (figure + i, frame))
                });
            let meshes: Vec<(usize, usize)> = each.collect();
            figure += sequence.sets.len();
            // Files that are listed are all drawn.
            let every = match sequence.sets.len() {
                2.. if self.svg.frames.is_empty() => self.every.or(Some(1)),
                _ => self.every,
            };
            let chosen = self.svg.chosen(meshes.len(), every)?;
            if chosen.len() > MOST_STILLS {
                let count = chosen.len();
                let what = format!(
                    "{count} meshes in one row of an SVG; at most {MOST_STILLS} are possible, see \
                     --every"
                );
                return Err(Error::usage(what));
            }
            let still = |frame: usize| {
                let Some((figure, own)) = meshes.get(frame) else {
                    let what = format!("frame {frame}: there are {}, counted from 0", meshes.len());
                    return Err(Error::usage(what));
                };
                Ok(Still {
                    figure: *figure,
                    frame: *own,
                    caption: caption(sequence, scene.rate, frame),
                })
            };
            let is_named = sequences.len() > 1 || !self.names.is_empty();
            rows.push(Row {
                name: if is_named {
                    sequence.name.clone()
                } else {
                    String::new()
                },
                stills: chosen.into_iter().map(still).collect::<Result<_>>()?,
            });
        }
        Ok(rows)
    }
}

/// What stands below a frame of a sequence: its label, or its number and time.
fn caption(sequence: &Sequence, rate: Option<f64>, frame: usize) -> String {
    match (sequence.labels.get(frame), rate) {
        (Some(label), _) => label.clone(),
        (None, Some(rate)) => format!("frame {frame} · {:.2} s", frame as f64 / rate),
        (None, None) => format!("frame {frame}"),
    }
}
