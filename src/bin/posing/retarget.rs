//! Carries motion to another skeleton.

use clap::Parser;
use posing::cli::args::{UpArgs, parse_rate};
use posing::cli::batch::{BatchJob, batch, each_told};
use posing::cli::choice::choice;
use posing::cli::endings::ending;
use posing::cli::fbx_choice::FbxChoiceArgs;
use posing::cli::input::{check_single_stdin, open, or_stdin};
use posing::cli::json_report::JsonArgs;
use posing::cli::name_maps::joint_map;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::ik::retarget::{Rest, RetargetOptions, Retargeted, Retargeter, up_axis};
use posing::io::SkinnedMesh;
use posing::io::bvh::LARGEST_FILE;
use posing::io::input::take_name;
use posing::io::motion_file::{ReadOptions, rig_of_fbx};
use posing::io::rotation_take::RotationTake;
use posing::io::{Asf, Bvh, Input, MotionFormat};
use posing::pose::NameMap;
use posing::pose::units::UpAxis;
use posing::{Error, Place, Result};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::PathBuf;

/// Carry motion to another skeleton: a rig of other proportions, names and rest pose
///
/// Reads BVH and FBX files, and AMC files with their ASF. Writes each as a BVH file with the
/// hierarchy of RIG.bvh, byte for byte, and the source's frames. Directions of limbs are the
/// source's; pelvis, spine, neck and head turn as the source's, whatever number of joints they
/// have. The middle of the hips moves by the ratio of the legs, and feet are planted as the
/// source's are: the ankle keeps the source's own roll, and knees bend to their own side. Feet turn
/// relative to how each skeleton stands: a sole that is level stays level, ankles are as high as
/// the rig's own, and toes never go under the ground. Fingers follow where they have the source's
/// names; other joints keep their rest pose. An AMC take has what the degrees of freedom of its ASF
/// skeleton allow.
///
/// Which joint is which is told by the names (maps as for complete), else by the shape of the tree.
/// Skeletons are compared in their rest pose, all rotations zero; where that is no standing body,
/// in the most upright frame of the file. Values that a source lacks (the word nan) are nan in the
/// result, in the joints that depend on them, and in no others: fill them first, with clean.
///
/// Standard error reports the maps, the scale and the feet. Exit code 3: values are missing; 1: a
/// file failed, all others are done.
#[derive(Parser)]
#[command(
    name = "retarget",
    version,
    after_help = "Examples:\
        \n  posing retarget --to hero.bvh walk.bvh -o hero-walk.bvh\
        \n  posing retarget --to hero.bvh --fps 120 07_01.amc -o hero-walk.bvh\
        \n  posing retarget --to hero.bvh walk.fbx -o hero-walk.glb\
        \n  posing retarget --to 07.asf walk.fbx -o walk.amc\
        \n  posing retarget --to hero.bvh --map-to cmu motions/ -o hero-motions/",
    mut_arg("left_handed", |left| left.help_heading("Input").help(
        "Axes of BVH sources are left-handed, as Unity's and Unreal's: one is reflected (FBX files \
         say it themselves)"
    )),
    mut_arg("up", |up| up.help_heading("Input").help(
        "Axis that points up in BVH sources [default: that along which the figure stands, else y]"
    ))
)]
pub struct Args {
    /// Takes (BVH, FBX, AMC), and folders that are searched for them; - or nothing: standard input
    #[arg(value_name = "IN")]
    inputs: Vec<PathBuf>,
    /// Rig whose hierarchy, channels and proportions the results have; of an FBX file the skeleton
    /// in its rest pose, of an ASF file that of AMC takes
    #[arg(long, value_name = "RIG.bvh|RIG.fbx|RIG.asf")]
    to: PathBuf,
    /// Write the result of one file to OUT instead of standard output, as GLB with a simple body if
    /// it ends in .glb, as the AMC take of the rig RIG.asf if in .amc; results of several files
    /// into the folder DIR
    #[arg(
        short,
        long,
        value_name = "OUT.bvh|OUT.glb|OUT.amc|DIR",
        help_heading = "Output"
    )]
    output: Option<OutputPath>,
    /// Names of the sources' joints: cmu, a shipped map or a TOML file [default: the map that
    /// fits, else the shape of the skeleton]
    #[arg(long, value_name = "NAME|FILE.toml", help_heading = "Method")]
    map_from: Option<String>,
    /// Names of the rig's joints, likewise
    #[arg(long, value_name = "NAME|FILE.toml", help_heading = "Method")]
    map_to: Option<String>,
    /// Do not plant feet on their soles: limbs, feet too, have exactly the source's directions
    #[arg(long, help_heading = "Method")]
    no_feet: bool,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's:
    /// 07.asf for 07_01.amc]
    #[arg(long, value_name = "SUBJECT.asf", help_heading = "Input")]
    asf: Option<PathBuf>,
    #[command(flatten)]
    fbx: FbxChoiceArgs,
    /// Skeleton of an FBX rig that has several, likewise
    #[arg(long, value_name = "NAME", help_heading = "Input")]
    to_skeleton: Option<String>,
    /// Frames per second of files that do not say it, as AMC files
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
    #[command(flatten)]
    axes: UpArgs,
    /// Axis that points up in the rig, and so in the results
    #[arg(
        long,
        value_parser = choice::<UpAxis>(),
        value_name = "AXIS",
        allow_hyphen_values = true,
        default_value = "y",
        help_heading = "Output"
    )]
    out_up: UpAxis,
    /// Accept a file whose last frame is cut off; that frame is dropped
    #[arg(long, help_heading = "Input")]
    keep_whole: bool,
    #[command(flatten)]
    json: JsonArgs,
}

/// What is the same for all files.
struct Job<'a> {
    rig: Retargeter,
    /// The rig's file.
    original: Vec<u8>,
    /// The skeleton that the rig is, of AMC takes.
    asf: Option<Asf>,
    map: Option<NameMap>,
    options: ReadOptions,
    args: &'a Args,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare(args.output.as_deref())?;
    let inputs = or_stdin(&args.inputs);
    check_single_stdin(inputs.iter().chain([&args.to]))?;
    let output = args.output.as_deref();
    let jobs = batch(&inputs, output, &["bvh", "fbx", "amc"], Some("bvh"))?;
    let options = args.fbx.chosen(ReadOptions {
        fps: args.fps,
        asf: args.asf.clone(),
        keep_whole: args.keep_whole,
        ..args.axes.options()
    });
    let name = args.to.display().to_string();
    let (original, asf) = rig(args, &name)?;
    if asf.is_none() && jobs.iter().any(|job| is_called(job, "amc")) {
        let what = format!("an AMC take is of an ASF skeleton; {name} is none: give --to RIG.asf");
        return Err(Error::usage(what));
    }
    let rig = Bvh::read(Input::new(&name, Cursor::new(original.clone()))?, 1.0, true)?;
    rig.notes.iter().for_each(|note| messages::info(note));
    let rig = Retargeter::new(
        rig,
        args.out_up,
        joint_map(args.map_to.as_deref())?.as_ref(),
    );
    let job = Job {
        rig: rig.map_err(|e| e.at(Place::file(name)))?,
        original,
        asf,
        map: joint_map(args.map_from.as_deref())?,
        options,
        args,
    };
    each_told(&jobs, &args.json, |one| job.retarget(one))
}

/// The text of the rig's BVH file, or of that which an FBX or ASF file becomes; the latter's
/// skeleton.
fn rig(args: &Args, name: &str) -> Result<(Vec<u8>, Option<Asf>)> {
    let bytes = open(&args.to)?.read_all(LARGEST_FILE)?;
    let format = MotionFormat::of(&bytes);
    if format == MotionFormat::Asf {
        if args.out_up != UpAxis::Y {
            return Err(Error::usage("--out-up: y points up in an ASF skeleton"));
        }
        let asf = Asf::read(Input::new(name, Cursor::new(bytes))?, None)?;
        return Ok((asf.to_bvh()?.to_bytes(1.0), Some(asf)));
    }
    if format == MotionFormat::Fbx {
        let (text, notes) = rig_of_fbx(name, bytes, args.to_skeleton.as_deref())?;
        notes
            .iter()
            .for_each(|note| messages::info(&format!("{name}: {note}")));
        return Ok((text, None));
    }
    Ok((bytes, None))
}

impl Job<'_> {
    fn retarget(&self, job: &BatchJob) -> Result<(Outcome, Value)> {
        let take = RotationTake::read(&job.input, open(&job.input)?, &self.options)?;
        take.notes.iter().for_each(|note| messages::info(note));
        let name = job.input.display().to_string();
        let own = match self.args.axes.up {
            Some(_) => None,
            None if take.says_up => None,
            None => up_axis(&take.bvh, self.map.as_ref())
                .map(|up| up.handed(self.args.axes.left_handed))
                .filter(|up| *up != take.up),
        };
        if let Some(up) = own {
            let up = up.name();
            messages::info(&format!(
                "{name}: the figure stands along {up}, which is taken for up; --up says otherwise"
            ));
        }
        let options = RetargetOptions {
            up: own.unwrap_or(take.up),
            rate: Some(take.rate),
            map: self.map.as_ref(),
            plants_feet: !self.args.no_feet,
        };
        let done = self.rig.retarget(&take.bvh, &options);
        let done = done.map_err(|e| e.at(Place::file(&name)))?;
        let bytes = self.result(job, &done.bvh, take.rate)?;
        if let Some(folder) = job.output.as_ref().and_then(|path| path.parent()) {
            std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        }
        write_bytes(job.output.as_deref(), &bytes, is_called(job, "glb"))?;
        report(&name, &done);
        Ok((Outcome::of(done.missing > 0), told(&done)))
    }

    /// The bytes of the result, BVH, GLB or AMC by its name.
    fn result(&self, job: &BatchJob, bvh: &Bvh, rate: f64) -> Result<Vec<u8>> {
        if let Some(asf) = self.asf.as_ref().filter(|_| is_called(job, "amc")) {
            let name = job.input.display().to_string();
            let made = asf.take_of(bvh).map_err(|e| e.at(Place::file(&name)));
            let (amc, [mean, most]) = made?;
            messages::info(&format!(
                "{name}: the skeleton's degrees of freedom leave bones {mean:.2} cm from the \
                 motion on average, {most:.2} at most; AMC says no rate: it is {rate}"
            ));
            return Ok(amc.to_bytes());
        }
        if !is_called(job, "glb") {
            return bvh.with_hierarchy_of(&self.original, 1.0);
        }
        let name = take_name(&job.input);
        let mesh = SkinnedMesh::of_bvh(&name, bvh, self.args.out_up.rotation(), rate);
        mesh.and_then(|mesh| mesh.to_glb())
            .map_err(|e| e.at(Place::file(job.input.display().to_string())))
    }
}

/// Whether the result of a file has this ending.
fn is_called(job: &BatchJob, called: &str) -> bool {
    let ending = job.output.as_deref().and_then(ending);
    ending.is_some_and(|ending| ending == called)
}

/// How a file became its result, for JSON.
fn told(done: &Retargeted) -> Value {
    let rest = |rest: Rest| match rest {
        Rest::Zero => json!("zero"),
        Rest::Frame(frame) => json!(frame),
        Rest::Assumed => json!("assumed"),
    };
    json!({
        "frames": done.bvh.motion.nrows(),
        "maps": done.maps,
        "scale": done.scale,
        "rest_poses": done.rests.map(rest),
        "resting_joints": done.resting,
        "contacts": done.contacts,
        "slide": done.slide,
        "raised": done.raised,
        "ground": done.ground,
        "missing": done.missing,
        "moves": done.moves,
    })
}

/// Says how a file became its result.
fn report(name: &str, done: &Retargeted) {
    let [from, to] = &done.maps;
    let feet = match done.contacts {
        Some(contacts) => {
            let s = if contacts == 1 { "" } else { "s" };
            let slide = done.slide;
            let ankles = if done.raised == 0.0 {
                String::new()
            } else {
                format!(
                    "; body moved by {:+.2} for the height of the rig's ankles",
                    done.raised
                )
            };
            format!(
                "; {contacts} contact{s} held, sliding {slide:.2} more than the source's at \
                 most{ankles}"
            )
        }
        None => String::new(),
    };
    messages::info(&format!(
        "{name}: {} frames, names {from} to {to}, scale {:.4}, {} joints keep their rest \
         pose{feet}",
        done.bvh.motion.nrows(),
        done.scale,
        done.resting
    ));
    let remedies = [
        "give a take in which it stands in a frame, or name its joints with --map-from",
        "give a RIG.bvh in which it stands in a frame, or name its joints with --map-to",
    ];
    let rests = ["its", "the rig's"].into_iter().zip(done.rests);
    for ((whose, rest), remedy) in rests.zip(remedies) {
        match rest {
            Rest::Zero => {}
            Rest::Frame(frame) => messages::info(&format!(
                "{name}: {whose} zero pose is no standing body; comparing by frame {}",
                frame + 1
            )),
            Rest::Assumed => messages::info(&format!(
                "{name}: {whose} zero pose is no standing body, and no frame is; comparing by the \
                 zero pose all the same, so limbs may point wrongly: {remedy}"
            )),
        }
    }
    if !done.moves {
        messages::info(&format!(
            "{name}: the rig has no position channels; it stays in place"
        ));
    }
    if done.missing > 0 {
        messages::info(&format!(
            "{name}: {} values are missing (nan), as those of the source; fill them with clean",
            done.missing
        ));
    }
}
