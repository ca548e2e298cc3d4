//! How the cost of coding and of learning grows with poses, atoms, sparsity and threads: `make
//! bench`.
//!
//! In this process, on frames of the CMU takes; every time is the median of three runs. Leaves
//! `target/bench/growth.html`, with a plot of each and the exponent b of seconds = a x^b, fitted to
//! the logarithms by least squares.

mod shared;

use ndarray::{Array2, ArrayView2, Axis, s};
use posing::numeric::parallel;
use posing::sparse::{Dictionary, Encoder, Ksvd, Omp};
use shared::{atoms, median};
use std::fmt::Write;

const RUNS: usize = 3;
const POSES: usize = 8_000;
const ATOMS: usize = 4_000;

fn main() {
    let takes = shared::takes();
    if takes.is_empty() {
        return println!("no takes at ../shared/data/cmu: nothing is coded");
    }
    let takes: Vec<_> = takes.iter().map(|t| t.xyz.view()).collect();
    let takes = ndarray::concatenate(Axis(0), &takes).expect("takes of the same points");
    if takes.nrows() < 8 * POSES {
        return println!(
            "{} frames are too few: {} are asked for",
            takes.nrows(),
            8 * POSES
        );
    }
    let mut order: Vec<usize> = (0..takes.nrows()).collect();
    rand::seq::SliceRandom::shuffle(&mut order[..], &mut parallel::rng(0, 0));
    let poses = takes.select(Axis(0), &order[..4 * POSES]);
    let mut rest = order.split_off(4 * POSES);
    rest.sort_unstable();
    let bench = Bench {
        takes: &takes,
        rest: &rest,
        poses: &poses,
    };
    let plots = [
        bench.poses(),
        bench.atoms(),
        bench.sparsity(),
        bench.threads(),
    ];
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("target/bench");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join("growth.html"), page(&plots)).expect("room for the page");
    println!("the plots: target/bench/growth.html");
}

/// Seconds at some numbers of one thing.
struct Line {
    name: &'static str,
    points: Vec<(f64, f64)>,
}

/// What is changed, what stays as it is, and the lines.
struct Plot {
    axis: &'static str,
    fixed: String,
    lines: Vec<Line>,
}

struct Bench<'a> {
    takes: &'a Array2<f32>,
    /// Frames that atoms are from.
    rest: &'a [usize],
    poses: &'a Array2<f32>,
}

impl Bench<'_> {
    fn dictionary(&self, n: usize) -> Dictionary {
        atoms(self.takes, self.rest, n)
    }

    fn poses(&self) -> Plot {
        let dictionary = self.dictionary(ATOMS);
        let at = [1, 2, 4, 8, 16, 32].map(|k| k * 1000);
        plot("poses", format!("{ATOMS} atoms, 3 a pose"), &at, |m| {
            let poses = self.poses.slice(s![..m, ..]);
            [code(&dictionary, poses, 3), learn(&dictionary, poses, 3)]
        })
    }

    /// Of more atoms than have a Gram matrix, and of fewer than there are poses.
    fn atoms(&self) -> Plot {
        let at = [3, 4, 6, 8, 12, 16].map(|k| k * 1000);
        let m = self.poses.nrows();
        plot("atoms", format!("{m} poses, 3 atoms a pose"), &at, |n| {
            let dictionary = self.dictionary(n);
            [
                code(&dictionary, self.poses.view(), 3),
                learn(&dictionary, self.poses.view(), 3),
            ]
        })
    }

    fn sparsity(&self) -> Plot {
        let dictionary = self.dictionary(ATOMS);
        plot(
            "sparsity",
            format!("{POSES} poses, {ATOMS} atoms"),
            &[1, 2, 3, 4, 6, 8],
            |k| {
                let poses = self.poses.slice(s![..POSES, ..]);
                [code(&dictionary, poses, k), learn(&dictionary, poses, k)]
            },
        )
    }

    fn threads(&self) -> Plot {
        let dictionary = self.dictionary(ATOMS);
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let mut at: Vec<usize> = (0..).map(|k| 1 << k).take_while(|k| *k < cores).collect();
        at.push(cores);
        plot(
            "threads",
            format!("{POSES} poses, {ATOMS} atoms, 3 a pose"),
            &at,
            |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let poses = self.poses.slice(s![..POSES, ..]);
                pool.expect("threads")
                    .install(|| [code(&dictionary, poses, 3), learn(&dictionary, poses, 3)])
            },
        )
    }
}

fn plot(
    axis: &'static str,
    fixed: String,
    at: &[usize],
    mut seconds: impl FnMut(usize) -> [f64; 2],
) -> Plot {
    let mut lines = [
        ("coding", Vec::new()),
        ("an iteration of K-SVD", Vec::new()),
    ];
    for &x in at {
        for (line, seconds) in lines.iter_mut().zip(seconds(x)) {
            line.1.push((x as f64, seconds));
        }
    }
    let lines = lines.map(|(name, points)| Line { name, points });
    println!("\n{axis} ({fixed})");
    for line in &lines {
        let points: Vec<String> = line
            .points
            .iter()
            .map(|(x, s)| format!("{x}: {s:.3}"))
            .collect();
        println!(
            "  {:<22} {}  s; {axis}^{:.2}",
            line.name,
            points.join(", "),
            line.exponent()
        );
    }
    Plot {
        axis,
        fixed,
        lines: lines.into(),
    }
}

fn code(dictionary: &Dictionary, poses: ArrayView2<'_, f32>, sparsity: usize) -> f64 {
    let omp = Omp {
        sparsity,
        ..Omp::default()
    };
    median(RUNS, || {
        // Its own, so that what is made for searches counts.
        let dictionary = Dictionary::from_rows(dictionary.atoms()).expect("atoms of unit norm");
        assert_eq!(
            Encoder::new(&dictionary, omp)
                .and_then(|encoder| encoder.encode(poses))
                .expect("finite poses")
                .len(),
            poses.nrows()
        );
    })
}

/// One iteration, from codes that are there.
fn learn(dictionary: &Dictionary, poses: ArrayView2<'_, f32>, sparsity: usize) -> f64 {
    let ksvd = Ksvd {
        iterations: 1,
        sparsity,
        ..Ksvd::default()
    };
    let start = ksvd
        .start(dictionary.clone(), poses, None)
        .expect("finite poses");
    median(RUNS, || {
        let mut state = start.clone();
        ksvd.run(&mut state, poses, None, &mut |_| Ok(()))
            .expect("finite poses");
    })
}

impl Line {
    fn exponent(&self) -> f64 {
        self.fit().1
    }

    /// ln a and b.
    fn fit(&self) -> (f64, f64) {
        let logs: Vec<(f64, f64)> = self.points.iter().map(|(x, s)| (x.ln(), s.ln())).collect();
        let mean =
            |of: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / logs.len() as f64;
        let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
        let spread = mean(&|p| (p.0 - x).powi(2));
        let b = mean(&|p| (p.0 - x) * (p.1 - y)) / spread.max(f64::MIN_POSITIVE);
        (y - b * x, b)
    }
}

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 62.0;
const BOTTOM: f64 = 44.0;
const MARGIN: f64 = 14.0;

fn page(plots: &[Plot]) -> String {
    let mut out = String::from(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>How cost grows</title><style>\
         :root{--ink:#1c2430;--soft:#69758a;--line:#dde3ec;--page:#fff;--a:#0b6bcb;--b:#c2410c}\
         @media(prefers-color-scheme:dark){:root{--ink:#e7ecf4;--soft:#95a1b5;--line:#2b3442;--page:#12171f;--a:#5aa9f5;--b:#f59056}}\
         body{font:15px/1.45 system-ui,sans-serif;color:var(--ink);background:var(--page);max-width:980px;margin:2rem auto;padding:0 1rem}\
         h1{font-size:1.4rem;margin-bottom:.2rem}p{color:var(--soft);margin-top:0}\
         main{display:grid;grid-template-columns:repeat(auto-fit,minmax(420px,1fr));gap:1.6rem}figure{margin:0}\
         figcaption{margin-bottom:.3rem}figcaption span{color:var(--soft)}svg{width:100%;height:auto;font:12px system-ui,sans-serif}\
         .grid{stroke:var(--line)}text{fill:var(--soft)}.a{color:var(--a)}.b{color:var(--b)}.a *,.b *{fill:currentColor}\
         .a path,.b path{fill:none;stroke:currentColor;stroke-width:1.6}</style>\
         <h1>How cost grows</h1><p>Seconds, both axes logarithmic; the lines are a x<sup>b</sup>, fitted. The median of three runs on this machine.</p><main>",
    );
    plots.iter().for_each(|plot| figure(&mut out, plot));
    out.push_str("</main></html>\n");
    out
}

fn figure(out: &mut String, plot: &Plot) {
    let points = || plot.lines.iter().flat_map(|l| &l.points);
    let bounds = |of: fn(&(f64, f64)) -> f64| {
        let (low, high) = points()
            .map(of)
            .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        (low / 1.25, high * 1.25)
    };
    let (xs, ys) = (bounds(|p| p.0), bounds(|p| p.1));
    let share = |v: f64, (low, high): (f64, f64)| (v / low).ln() / (high / low).ln();
    let x = |v: f64| LEFT + share(v, xs) * (WIDTH - LEFT - MARGIN);
    let y = |v: f64| HEIGHT - BOTTOM - share(v, ys) * (HEIGHT - BOTTOM - MARGIN);
    let _ = write!(
        out,
        "<figure><figcaption><b>{}</b> <span>{}</span></figcaption><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"seconds by {}\">",
        plot.axis, plot.fixed, plot.axis
    );
    for v in ticks(ys) {
        let _ = write!(
            out,
            "<path class=\"grid\" d=\"M{LEFT} {0:.1}H{1}\"/><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\">{v} s</text>",
            y(v),
            WIDTH - MARGIN,
            LEFT - 8.0,
            y(v) + 4.0
        );
    }
    for (v, _) in &plot.lines[0].points {
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{v}</text>",
            x(*v),
            HEIGHT - BOTTOM + 20.0
        );
    }
    for (i, (line, class)) in plot.lines.iter().zip(["a", "b"]).enumerate() {
        let (a, b) = line.fit();
        let at = |v: f64| y((a + b * v.ln()).exp());
        let ends = (line.points[0].0, line.points[line.points.len() - 1].0);
        let _ = write!(
            out,
            "<g class=\"{class}\"><path d=\"M{:.1} {:.1}L{:.1} {:.1}\"/>",
            x(ends.0),
            at(ends.0),
            x(ends.1),
            at(ends.1)
        );
        for (v, s) in &line.points {
            let _ = write!(
                out,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.4\"/>",
                x(*v),
                y(*s)
            );
        }
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{}\">{}: b = {b:.2}</text></g>",
            LEFT + 8.0,
            MARGIN + 12.0 + 17.0 * i as f64,
            line.name
        );
    }
    out.push_str("</svg></figure>");
}

/// 1, 2 and 5 times powers of ten.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let all =
        powers.flat_map(|p| [1, 2, 5].map(|d| format!("{d}e{p}").parse::<f64>().unwrap_or(0.0)));
    all.filter(|v| *v >= low && *v <= high).collect()
}
