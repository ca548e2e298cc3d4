//! Serves a page on which a figure is posed by hand.

use clap::Parser;
use posing::Result;
use posing::cli::args::{BvhUnitArgs, InputArgs};
use posing::cli::ik::{name_bone_ends, read_skeleton};
use posing::cli::input::{check_single_stdin, open_model, read_table};
use posing::cli::name_maps::name_map;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::cli::{browser, messages, signals};
use posing::edit;
use posing::io::Table;
use posing::prior::builtin_model;
use posing::restore::PoseModel;
use posing::server::editor::{EditSource, Editor};
use posing::server::figure::Figure;
use posing::server::{Page, page, serve};
use std::path::{Path, PathBuf};

/// Pose a figure by hand: drag joints on a local page
///
/// Prints the page's address and opens it in the browser; Ctrl-C ends the program. Only this
/// machine can open the page, and only with the token in the address. To work from another machine,
/// use ssh -L PORT:127.0.0.1:PORT with --port PORT.
///
/// Drag a joint, and the rest of the figure follows as the pose model finds natural; bones keep
/// their lengths. A pinned joint stays exactly where it is. One slider says how far the other
/// joints may go from where they were: from staying, as in inverse kinematics, to following the
/// model. What is out of reach is said, with its distance. The page also poses the figure from
/// joints that are marked on a photograph (which never leaves the page), keeps key poses and plays
/// what lies between them, and saves BVH, CSV (with the standard deviation of each joint, and
/// whether a pin holds it), AMC for an ASF skeleton, and the session. The page's own help lists
/// keys and fingers.
///
/// Without --skeleton the figure has the bones of POSES, or of the model. Joints are matched with
/// the model's points by name, or by --map: a shipped map of names (posing complete --help lists
/// them), or a TOML file of lines such as lhumerus = "LeftForeArm": the point of the model, then
/// the joint. Without it, the shipped map that fits is taken where the model knows none of the
/// names.
#[derive(Parser)]
#[command(
    name = "edit",
    version,
    after_help = "Examples:\n  posing edit\
        \n  posing edit --skeleton 07.asf walk.csv\
        \n  posing edit --session pose.json --no-open --port 8000"
)]
pub struct Args {
    /// Pose table whose rows can be edited, CSV or NPY; -: standard input
    #[arg(value_name = "POSES")]
    poses: Option<PathBuf>,
    /// Model file (default: the built-in model)
    #[arg(short, long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Skeleton of the figure, ASF, BVH or FBX
    #[arg(long, value_name = "SUBJECT.asf|FILE.bvh")]
    skeleton: Option<PathBuf>,
    /// Which joints of the skeleton are the model's
    #[arg(long, value_name = "NAME|FILE.toml", requires = "skeleton")]
    map: Option<String>,
    /// Keep the session in FILE, and go on with it if it exists
    #[arg(long, value_name = "FILE.json")]
    session: Option<OutputPath>,
    /// Port of the page's address; 0: any that is free
    #[arg(long, value_name = "P", default_value_t = 0)]
    port: u16,
    /// Do not open the browser
    #[arg(long)]
    no_open: bool,
    #[command(flatten)]
    units: BvhUnitArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let files = [&args.poses, &args.model, &args.skeleton];
    check_single_stdin(files.into_iter().flatten())?;
    let model = match &args.model {
        Some(path) => edit::open_model(&open_model(path)?, &path.display().to_string())?,
        None => edit::open_model(&builtin_model()?, "the built-in model")?,
    };
    let table = args
        .poses
        .as_deref()
        .map(|path| table(args, path))
        .transpose()?;
    let source = EditSource {
        figure: figure(args, &model, table.as_ref())?,
        session: args.session.as_deref().map(Path::to_path_buf),
        model,
        table,
        option_names: messages::option_names(),
    };
    let page = Page {
        html: page::page(),
        policy: page::policy(),
    };
    // Removed when the server has ended.
    let mut redirecting = None;
    let handler = move || Editor::open(source);
    serve(args.port, page, handler, |address, running| {
        signals::on_stop(move || drop(running));
        write_bytes(None, format!("{address}\n").as_bytes(), false)?;
        if !args.no_open {
            redirecting = browser::open(address);
        }
        Ok(())
    })
}

/// The table whose rows are edited; its points are the ends of bones.
fn table(args: &Args, path: &Path) -> Result<Table> {
    let input = InputArgs::plain(vec![path.to_path_buf()], None);
    let mut table = read_table(&input, false, false)?;
    name_bone_ends(
        &mut table.poses,
        &table.name,
        false,
        args.skeleton.is_some(),
    )?;
    Ok(table)
}

/// The skeleton given, or one measured from the table, or from the model.
fn figure(args: &Args, model: &PoseModel, table: Option<&Table>) -> Result<Figure> {
    let (unit, turn) = (args.units.centimeters(), args.units.rotation());
    let figure = match (&args.skeleton, table) {
        (Some(path), _) => {
            let file = read_skeleton(path, unit, turn)?;
            let map = args
                .map
                .as_deref()
                .map(|name| name_map(name, &model.points));
            let name = path.display().to_string();
            Figure::of_file(&name, file, map.transpose()?.as_ref(), &model.points)?
        }
        (None, Some(table)) => Figure::measured(&table.name, &table.poses)?,
        (None, None) => Figure::measured("the model's own figure", &model.representative_poses())?,
    };
    Ok(figure.with_units(unit, turn.transpose()))
}
