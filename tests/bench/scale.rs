//! Lai et al.'s scale, from poses to codes: `make scale` (`make scale POSES=20000`: a hundredth of
//! it).
//!
//! 2,075,000 poses are clustered, a dictionary is learned of each cluster, the dictionaries are
//! joined to about 262,759 atoms, and 50,000 poses of other takes are coded with them. The poses
//! are made from the CMU takes at `../shared/data/cmu`, which have fewer: see [`Maker`]. Every
//! stage is the commands that a user would run, one or more processes, in `target/scale`, where the
//! dictionary and the codes stay. Of each stage the seconds and the peak of its memory (resident,
//! of all processes that run at once) are printed; of the training also the seconds of the parts.
//! posing-scale(7) has these figures.

mod shared;

use ndarray::ArrayView1;
use posing::io::npy;
use posing::numeric::parallel;
use posing::pose::sides::mirrored;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use shared::Take;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const POSES: usize = 2_075_000;
const ATOMS: usize = 262_759;
const CODED: usize = 50_000;
const CLUSTERS: usize = 200;
const ITERATIONS: &str = "10";
/// One take in so many is kept for the poses that are coded.
const HELD_OUT: usize = 10;

fn main() {
    let size = Size::asked();
    let takes = shared::takes();
    if takes.is_empty() {
        return println!("no takes at ../shared/data/cmu: nothing is learned");
    }
    let work = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/scale");
    std::fs::remove_dir_all(work.join("parts")).ok();
    std::fs::create_dir_all(&work).expect("a folder");
    size.make(takes, &work);
    let mut all = Stages::default();
    learn(&mut all, &work, size.poses * CLUSTERS / POSES);
    let learning = all.seconds;
    let mut encode = command("encode");
    encode
        .arg("-m")
        .arg(work.join("dict.npz"))
        .arg("-o")
        .arg(work.join("codes.csv"));
    all.run(
        &format!("encode {} poses", size.coded),
        1,
        [encode.arg(work.join("unseen.npy"))],
    );
    println!("{:<28} {:>8.1} {:>8.2}", "all", all.seconds, all.memory);
    let minutes = (all.seconds - learning) / 60.0 * size.poses as f64 / size.coded as f64;
    println!(
        "{} poses would be coded in {minutes:.1} minutes",
        size.poses
    );
    println!(
        "RMS of the codes {:.3} cm a coordinate",
        rms(&work.join("codes.csv"))
    );
    // Two gigabytes.
    std::fs::remove_dir_all(work.join("parts")).expect("the parts");
    std::fs::remove_file(work.join("poses.npy")).expect("the poses");
}

/// How many poses are learned from and coded.
struct Size {
    poses: usize,
    coded: usize,
}

impl Size {
    /// What `--poses N` asks for, else Lai et al.'s.
    fn asked() -> Size {
        let mut flags = std::env::args().skip_while(|a| a != "--poses").skip(1);
        let poses = flags
            .next()
            .map_or(POSES, |n| n.parse().expect("--poses N"));
        Size {
            poses,
            coded: (poses / (POSES / CODED)).max(1),
        }
    }

    /// Writes the poses to learn from, and those of other takes to code.
    fn make(&self, takes: Vec<Take>, work: &Path) {
        let began = Instant::now();
        let (coded, learned): (Vec<_>, Vec<_>) = takes
            .into_iter()
            .enumerate()
            .partition(|(i, _)| i % HELD_OUT == 0);
        let frames = make(&learned, self.poses, 0, &work.join("poses.npy"));
        let unseen = make(&coded, self.coded, 1, &work.join("unseen.npy"));
        let seconds = began.elapsed().as_secs_f64();
        println!(
            "{} poses made of {frames} frames, {} of {unseen} frames of other takes: {seconds:.0} s",
            self.poses, self.coded
        );
    }
}

/// From the poses to `dict.npz`.
fn learn(all: &mut Stages, work: &Path, clusters: usize) {
    let (parts, clusters) = (work.join("parts"), clusters.max(4));
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    println!("{cores} threads\n{:<28} {:>8} {:>8}", "", "seconds", "GB");
    let mut cluster = command("cluster");
    cluster.args(["-k", &clusters.to_string(), "--balance"]);
    cluster.args(["--to", "npy", "--split"]).arg(&parts);
    all.run(
        &format!("cluster into {clusters}"),
        1,
        [cluster.arg(work.join("poses.npy"))],
    );
    let files = shared::files(&parts, "npy");
    let mut training: Vec<Command> = files.iter().map(|part| train(part)).collect();
    all.run("ksvd-train, a cluster each", cores, &mut training);
    let mut join = command("dict-concat");
    join.arg("--quiet").arg("-o").arg(work.join("dict.npz"));
    all.run("dict-concat", 1, [join.args(shared::files(&parts, "npz"))]);
}

/// K-SVD on one cluster: as many atoms as its share of the poses, on one thread.
fn train(part: &Path) -> Command {
    let size = std::fs::metadata(part).map_or(0, |m| m.len()) as usize;
    let poses = size / (8 * 69);
    let atoms = (poses * ATOMS).div_ceil(POSES).clamp(1, poses);
    let mut command = command("ksvd-train");
    command.args([
        "--space",
        "body",
        "--threads",
        "1",
        "--iterations",
        ITERATIONS,
    ]);
    command
        .args(["-n", &atoms.to_string()])
        .arg("-o")
        .arg(part.with_extension("npz"))
        .arg(part);
    command
}

fn command(name: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_posing"));
    command.args([name, "-q"]).stdin(Stdio::null());
    command
}

/// What the stages took so far, told as they end.
#[derive(Default)]
struct Stages {
    seconds: f64,
    memory: f64,
}

impl Stages {
    /// Runs the commands of a stage, so many at once.
    fn run<'a>(
        &mut self,
        name: &str,
        at_once: usize,
        commands: impl IntoIterator<Item = &'a mut Command>,
    ) {
        let began = Instant::now();
        let mut waiting = commands.into_iter();
        let mut running: Vec<(Child, Instant, f64)> = Vec::new();
        let (mut peak, mut own) = (0f64, Vec::new());
        loop {
            while running.len() < at_once {
                let Some(command) = waiting.next() else { break };
                let child = command.spawn().expect("a command of the project");
                running.push((child, Instant::now(), 0.0));
            }
            if running.is_empty() {
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
            for (child, _, most) in &mut running {
                *most = resident(child.id()).max(*most);
            }
            peak = peak.max(running.iter().map(|(_, _, most)| most).sum());
            running.retain_mut(
                |(child, started, _)| match child.try_wait().expect("a child") {
                    Some(status) => {
                        assert!(status.success(), "{name} failed");
                        own.push(started.elapsed().as_secs_f64());
                        false
                    }
                    None => true,
                },
            );
        }
        let seconds = began.elapsed().as_secs_f64();
        println!("{name:<28} {seconds:>8.1} {peak:>8.2}");
        if own.len() > 1 {
            let (all, longest) = (
                own.iter().sum::<f64>(),
                own.iter().copied().fold(0.0, f64::max),
            );
            let (mean, gain) = (all / own.len() as f64, all / seconds);
            println!(
                "{:<28} {all:>8.1}: the sum of {} parts, {gain:.2} times the wait; mean {mean:.2}, longest {longest:.2}",
                "",
                own.len()
            );
        }
        self.seconds += seconds;
        self.memory = self.memory.max(peak);
    }
}

/// The most memory that a process has had resident, GB; 0 where the system does not tell (it is
/// Linux that does).
fn resident(process: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|l| l.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kilobytes.unwrap_or_default() * 1024e-9
}

/// Makes poses of takes: each is a moment between two frames of a take, half of them blended with
/// another moment of the same take (up to half of the pose is the other's), half of them mirrored.
struct Maker<'a> {
    takes: &'a [(usize, Take)],
    /// The column that each column of a mirrored pose comes from, and its sign.
    mirror: Vec<(usize, f32)>,
    chance: ChaCha8Rng,
}

impl Maker<'_> {
    fn new(takes: &[(usize, Take)], stream: u64) -> Maker<'_> {
        let points = &takes[0].1.points;
        let source = |p: usize| mirrored(points, p).unwrap_or(p);
        // Body space has x to the left: that is what a mirror turns.
        let mirror = (0..3 * points.len()).map(|c| {
            (
                3 * source(c / 3) + c % 3,
                if c % 3 == 0 { -1.0 } else { 1.0 },
            )
        });
        Maker {
            takes,
            mirror: mirror.collect(),
            chance: parallel::rng(0, stream),
        }
    }

    fn pose(&mut self, frames: usize) -> Vec<f32> {
        let mut frame = self.chance.random_range(0..frames);
        let take = self.takes.iter().map(|(_, t)| t).find(|t| {
            let here = frame < t.xyz.nrows();
            frame -= if here { 0 } else { t.xyz.nrows() };
            here
        });
        let take = take.expect("a frame of a take");
        let mut pose = self.moment(take);
        if self.chance.random() {
            let (other, share) = (self.moment(take), self.chance.random_range(0.0..0.5));
            pose = mix(ArrayView1::from(&pose), ArrayView1::from(&other), share);
        }
        if self.chance.random() {
            pose = self
                .mirror
                .iter()
                .map(|&(from, sign)| sign * pose[from])
                .collect();
        }
        pose
    }

    fn moment(&mut self, take: &Take) -> Vec<f32> {
        let last = take.xyz.nrows() - 1;
        let time = self.chance.random_range(0.0..=last as f32);
        let before = (time as usize).min(last.saturating_sub(1));
        mix(
            take.xyz.row(before),
            take.xyz.row((before + 1).min(last)),
            time - before as f32,
        )
    }
}

fn mix(a: ArrayView1<f32>, b: ArrayView1<f32>, share: f32) -> Vec<f32> {
    a.iter()
        .zip(b)
        .map(|(a, b)| (1.0 - share) * a + share * b)
        .collect()
}

/// Writes so many poses; how many frames they are made of.
fn make(takes: &[(usize, Take)], poses: usize, stream: u64, to: &Path) -> usize {
    let frames = takes.iter().map(|(_, t)| t.xyz.nrows()).sum();
    let mut maker = Maker::new(takes, stream);
    let mut file = BufWriter::new(std::fs::File::create(to).expect("a file"));
    let width = maker.mirror.len();
    file.write_all(&npy::header_of("<f4", &[poses, width]))
        .expect("room for the poses");
    for _ in 0..poses {
        for number in maker.pose(frames) {
            file.write_all(&number.to_le_bytes())
                .expect("room for the poses");
        }
    }
    file.flush().expect("room for the poses");
    frames
}

/// Of all codes together: the last column is that of each.
fn rms(codes: &Path) -> f64 {
    let text = std::fs::read_to_string(codes).expect("the codes");
    let squares: Vec<f64> = (text.lines().skip(1))
        .filter_map(|l| l.rsplit(',').next()?.parse::<f64>().ok())
        .map(|rms| rms * rms)
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}
