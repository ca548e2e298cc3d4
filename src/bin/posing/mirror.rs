//! Exchanges left and right.

use clap::Parser;
use posing::Result;
use posing::cli::endings::{check_ending, ending_of};
use posing::cli::messages;
use posing::cli::paths::OutputPath;
use posing::cli::read_args::ReadArgs;
use posing::cli::streams::write_bytes;
use posing::ik::retarget::up_axis;
use posing::io::MotionFile;
use posing::io::motion_file::Source;
use std::path::PathBuf;

/// Exchange left and right, as a mirror does
///
/// Takes any file of motion (C3D, TRC, BVH, FBX, CSV, ...) and writes its mirror image in its own
/// format, FBX as BVH. Positions are reflected (x to -x in a take that is y up), and markers of the
/// left take the places of those of the right. In BVH files, rotations, offsets and channels of the
/// left and right change sides and signs, along the axis that parts the sides in the zero pose.
/// Names and their order stay; what is missing is missing on the other side. The mirror image of
/// the mirror image is the file.
///
/// Sides are told by names: Left and Right, L and R, l and r, as in LeftArm, hand_L, LFHD, lfemur.
/// What has no other side is reflected under its own name; a line names it, if a word or a letter
/// of its own says a side. AMC files, whose axes differ from side to side, are refused.
#[derive(Parser)]
#[command(
    name = "mirror",
    version,
    after_help = "Examples:\
        \n  posing mirror walk.bvh -o mirrored.bvh\
        \n  posing mirror markers.c3d -o mirrored.c3d\
        \n  posing mirror --pairs lfemur:rfemur walk.csv -o mirrored.csv"
)]
pub struct Args {
    /// File of motion
    #[arg(value_name = "IN")]
    file: PathBuf,
    /// Write to OUT instead of standard output; it appears only when it is complete
    #[arg(short, long, value_name = "OUT", help_heading = "Output")]
    output: Option<OutputPath>,
    /// Pairs of names that are two sides, beside those that the names tell; several parted by
    /// commas
    #[arg(
        long,
        value_name = "LEFT:RIGHT",
        value_delimiter = ',',
        value_parser = parse_pair,
        help_heading = "Method"
    )]
    pairs: Vec<(String, String)>,
    #[command(flatten)]
    read: ReadArgs,
}

/// Two names; a colon of a prefix is none between them.
fn parse_pair(text: &str) -> std::result::Result<(String, String), String> {
    let colons: Vec<usize> = text.match_indices(':').map(|(at, _)| at).collect();
    match colons.get(colons.len() / 2) {
        Some(at) if colons.len() % 2 == 1 && *at > 0 && at + 1 < text.len() => {
            Ok((text[..*at].into(), text[at + 1..].into()))
        }
        _ => Err("expected LEFT:RIGHT".into()),
    }
}

pub fn work(args: &Args) -> Result<()> {
    let rules = args.read.rules()?;
    let file = MotionFile::open_by(&args.file, &rules)?;
    let name = args.file.display();
    check_ending(args.output.as_deref(), &ending_of(file.format))?;
    let rate = file
        .read_as
        .rate
        .as_ref()
        .filter(|rate| rate.from == Source::File);
    if rate.is_some() {
        file.check_rate(rules.of(&args.file, file.format).fps)?;
    }
    let custom = file
        .bvh()
        .filter(|_| file.read_as.up.from == Source::Custom);
    let stands = custom.and_then(|bvh| up_axis(bvh, None));
    if let Some(up) = stands.filter(|up| *up != file.units().up) {
        let up = up.name();
        messages::info(&format!(
            "{name}: the figure stands along {up}, which is taken for up; --up says otherwise"
        ));
    }
    let image = file.mirror_image(&args.pairs, stands)?;
    for note in &image.notes {
        messages::info(&format!("{name}: {note}"));
    }
    let alone = match &image.alone[..] {
        [] => String::new(),
        names => format!("; without another side: {}", names.join(", ")),
    };
    messages::info(&format!(
        "{name}: {} {} sides{alone}",
        image.pairs,
        if image.pairs == 1 {
            "pair changes"
        } else {
            "pairs change"
        }
    ));
    write_bytes(
        args.output.as_deref(),
        &image.bytes,
        file.format.is_binary(),
    )
}
