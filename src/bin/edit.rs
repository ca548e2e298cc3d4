//! Serves a page on which a figure is posed by hand.

use clap::Parser;
use posing::Result;
use posing::cli::args::CommonArgs;
use posing::cli::edit_server::{Answer, Page, Refusal, Reply, Request, browser, serve};
use posing::cli::input::check_single_stdin;
use posing::cli::run;
use posing::cli::streams::write_bytes;
use posing::cli::units::{Units, Up};
use std::path::PathBuf;
use std::process::ExitCode;

/// Pose a figure by hand: drag joints on a local page
///
/// Prints the page's address and opens it in the browser; Ctrl-C ends the program. Only this machine can open the page, and
/// only with the token in the address. To work from another machine, use ssh -L PORT:127.0.0.1:PORT with --port PORT.
#[derive(Parser)]
#[command(
    name = "edit",
    version,
    after_help = "Examples:\n  posing edit\n  posing edit --skeleton 07.asf walk.csv\n  posing edit --session pose.json --no-open --port 8000"
)]
struct Args {
    /// Pose table whose rows can be edited, CSV or NPY; -: standard input
    #[arg(value_name = "POSES")]
    poses: Option<PathBuf>,
    /// Model file (default: the built-in model)
    #[arg(short, long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Skeleton of the figure, ASF or BVH
    #[arg(long, value_name = "SUBJECT.asf|FILE.bvh")]
    skeleton: Option<PathBuf>,
    /// Which joints of the skeleton are the model's
    #[arg(long, value_name = "FILE.toml", requires = "skeleton")]
    map: Option<PathBuf>,
    /// Keep the session in FILE, and go on with it if it exists
    #[arg(long, value_name = "FILE.json")]
    session: Option<PathBuf>,
    /// Port of the page's address; 0: any that is free
    #[arg(long, value_name = "P", default_value_t = 0)]
    port: u16,
    /// Do not open the browser
    #[arg(long)]
    no_open: bool,
    /// Unit of length of the files read and written
    #[arg(long, value_enum, value_name = "UNIT", default_value = "cm")]
    units: Units,
    /// Axis that points up in the files read and written
    #[arg(long, value_enum, value_name = "AXIS", default_value = "y")]
    up: Up,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<()> {
    args.common.apply()?;
    let files = [&args.poses, &args.model, &args.skeleton, &args.map];
    check_single_stdin(files.into_iter().flatten())?;
    let _ = (&args.session, args.units, args.up);
    let page = Page {
        html: "<!doctype html><title>posing edit</title>".into(),
        policy: "default-src 'none'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'".into(),
    };
    // Removed when the server has ended.
    let mut redirecting = None;
    serve(
        args.port,
        page,
        || Ok(Empty),
        |address| {
            write_bytes(None, format!("{address}\n").as_bytes(), false)?;
            if !args.no_open {
                redirecting = browser::open(address);
            }
            Ok(())
        },
    )
}

/// Answers `{}` to everything.
struct Empty;

impl Answer for Empty {
    fn answer(&mut self, _: &Request) -> std::result::Result<Reply, Refusal> {
        Ok(Reply::json(b"{}".to_vec()))
    }
}
