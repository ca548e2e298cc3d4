//! A curve of both sides over the gait cycle as SVG.

use crate::draw::html::escape;
use crate::draw::text_table::short;
use std::fmt::Write;

/// The plot in the picture's units: its left and right, its top and bottom.
const X: [f64; 2] = [38.0, 312.0];
const Y: [f64; 2] = [8.0, 152.0];
/// The picture.
const SIZE: [f64; 2] = [320.0, 172.0];
/// Single cycles are drawn of a side that has no more.
const SINGLE: usize = 10;
/// So much of a whole cycle is known, percent: kinetics lack some frames at a trial's ends.
const WHOLE: usize = 90;
/// The half of a normal distribution's 95 %, in its deviations.
const HALF_95: f64 = 1.96;

/// A curve of a side over the cycle, a value a percent; NaN where it is not known.
#[derive(Debug, Default)]
pub(crate) struct SideCurve {
    /// The cycles.
    pub cycles: Vec<SingleCycle>,
    /// Their mean, and standard deviation.
    pub mean: Vec<f64>,
    pub sd: Vec<f64>,
    /// When the foot leaves the floor, percent.
    pub foot_off: Option<f64>,
}

/// A curve of a single cycle.
#[derive(Debug)]
pub(crate) struct SingleCycle {
    /// The trial and the number of the cycle.
    pub name: String,
    /// The values.
    pub values: Vec<f64>,
    /// Their deviations where markers were filled or doubted, 0 elsewhere.
    pub sd: Option<Vec<f64>>,
}

/// A chart.
#[derive(Debug)]
pub(crate) struct Chart<'a> {
    /// What it shows.
    pub title: &'a str,
    /// The unit.
    pub unit: &'a str,
    /// The least span of its axis: smaller curves are flat.
    pub least: f64,
    /// Both sides.
    pub sides: [SideCurve; 2],
    /// Mean and standard deviation of a norm.
    pub norm: Option<[&'a [f64]; 2]>,
}

impl SideCurve {
    /// The number of cycles that are known all along, ends aside.
    pub(crate) fn whole(&self) -> usize {
        let is_known = |c: &&SingleCycle| {
            let known = c.values.iter().filter(|v| v.is_finite()).count();
            100 * known >= WHOLE * c.values.len()
        };
        self.cycles.iter().filter(is_known).count()
    }
}

/// What is drawn: its class, a line or both edges of an area, and its name.
type Shape<'a> = (String, Vec<Vec<f64>>, &'a str);

/// The edges of a band about a curve.
fn band(mean: &[f64], sd: &[f64], times: f64) -> Vec<Vec<f64>> {
    let edge = |by: f64| mean.iter().zip(sd).map(|(m, sd)| m + by * sd).collect();
    [times, -times].map(edge).to_vec()
}

/// The least and the largest of those of some values that are known.
fn ends<'a>(values: impl Iterator<Item = &'a f64>) -> Option<[f64; 2]> {
    let both = values.filter(|v| v.is_finite()).map(|v| [*v, *v]);
    both.reduce(|[low, high], [v, _]| [low.min(v), high.max(v)])
}

/// The values of a vertical axis.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    /// An axis of round numbers, at most seven, that holds both ends.
    fn of([low, high]: [f64; 2], least: f64) -> Axis {
        let more = (least - (high - low)).max(0.0) / 2.0;
        let (low, high) = (low - more, high + more);
        let power = 10f64.powf(((high - low) / 5.0).log10().floor());
        let mut steps = [1.0, 2.0, 5.0].map(|s| s * power).into_iter();
        let step = steps.find(|s| (high - low) / s <= 5.0);
        let step = step.unwrap_or(10.0 * power);
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        Axis { low, high, step }
    }

    fn y(&self, value: f64) -> f64 {
        let share = ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        Y[1] - share * (Y[1] - Y[0])
    }

    fn ticks(&self) -> impl Iterator<Item = f64> {
        let count = ((self.high - self.low) / self.step).round() as usize;
        (0..=count).map(|i| self.low + i as f64 * self.step)
    }

    /// The number of a tick, with as many decimals as the step has.
    fn number(&self, tick: f64) -> String {
        if tick.abs() < self.step / 2.0 {
            return "0".into();
        }
        let decimals = (-self.step.log10() - 1e-9).ceil().clamp(0.0, 6.0) as usize;
        format!("{tick:.decimals$}").replace('-', "\u{2212}")
    }

    /// A shape as a path; nothing where it is not known.
    fn path(&self, (class, edges, name): &Shape<'_>) -> String {
        let is_known = |i: &usize| edges.iter().all(|edge| edge[*i].is_finite());
        let point = |edge: &[f64], i: usize| format!("{:.1} {:.1}", x(i as f64), self.y(edge[i]));
        let known: Vec<usize> = (0..edges[0].len()).filter(is_known).collect();
        let mut path = String::new();
        for run in known.chunk_by(|a, b| a + 1 == *b) {
            let mut points: Vec<String> = run.iter().map(|i| point(&edges[0], *i)).collect();
            if let Some(other) = edges.get(1) {
                points.extend(run.iter().rev().map(|i| point(other, *i)));
            }
            path += &format!("M{}", points.join("L"));
        }
        let title = match *name {
            "" => String::new(),
            name => format!("<title>{}</title>", escape(name)),
        };
        match &path[..] {
            "" => path,
            path => format!("<path class=\"{class}\" d=\"{path}\">{title}</path>"),
        }
    }
}

fn x(percent: f64) -> f64 {
    X[0] + (X[1] - X[0]) * percent / 100.0
}

impl Chart<'_> {
    /// The chart with its title in a column of three; `None` without any value.
    pub(crate) fn figure(&self, column: usize) -> Option<String> {
        if self.sides.iter().all(|side| side.cycles.is_empty()) {
            return None;
        }
        let shapes = self.shapes();
        let values = shapes
            .iter()
            .filter(|(class, ..)| !class.starts_with("doubt"));
        let values = values.flat_map(|(_, edges, _)| edges.iter().flatten());
        let axis = Axis::of(ends(values)?, self.least);
        let drawn: String = shapes.iter().map(|shape| axis.path(shape)).collect();
        let ([width, height], frame) = (SIZE, self.frame(&axis));
        Some(format!(
            "<figure class=\"at{column}\"><figcaption>{} <small>{}</small></figcaption><svg \
             viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\">{frame}{drawn}</svg>\
             </figure>\n",
            escape(self.title),
            self.unit.replace(' ', "\u{a0}"),
            escape(&self.label())
        ))
    }

    /// What is drawn, from behind to front.
    fn shapes(&self) -> Vec<Shape<'_>> {
        let sides = || self.sides.iter().zip(["l", "r"]);
        let norm = self
            .norm
            .map(|[mean, sd]| ("norm".into(), band(mean, sd, 1.0), ""));
        let mut all: Vec<Shape<'_>> = norm.into_iter().collect();
        for (side, letter) in sides() {
            all.push((format!("sd {letter}"), band(&side.mean, &side.sd, 1.0), ""));
            let filled = |sd: &f64| if *sd > 0.0 { *sd } else { f64::NAN };
            all.extend(side.cycles.iter().filter_map(|c| {
                let sd: Vec<f64> = c.sd.as_ref()?.iter().map(filled).collect();
                Some((
                    format!("doubt {letter}"),
                    band(&c.values, &sd, HALF_95),
                    &*c.name,
                ))
            }));
        }
        for (side, letter) in sides().filter(|(s, _)| (2..=SINGLE).contains(&s.cycles.len())) {
            let shapes = side.cycles.iter();
            all.extend(shapes.map(|c| (format!("one {letter}"), vec![c.values.clone()], &*c.name)));
        }
        all.extend(sides().map(|(side, l)| (format!("mean {l}"), vec![side.mean.clone()], "")));
        all
    }

    /// Axes with their numbers, and when the feet leave the floor.
    fn frame(&self, axis: &Axis) -> String {
        let ([left, right], [top, end]) = (X, Y);
        let mut out = String::new();
        for tick in axis.ticks() {
            let (y, number) = (axis.y(tick), axis.number(tick));
            let class = if number == "0" { "zero" } else { "tick" };
            // Writing to memory cannot fail.
            let _ = write!(
                out,
                "<path class=\"{class}\" d=\"M{left} {y:.1}H{right}\"/><text class=\"y\" x=\"{}\" \
                 y=\"{:.1}\">{number}</text>",
                left - 4.0,
                y + 3.8
            );
        }
        for percent in [0, 20, 40, 60, 80, 100] {
            let at = x(f64::from(percent));
            let (class, text_at, unit) = match percent {
                100 => ("end", SIZE[0], " %"),
                _ => ("x", at, ""),
            };
            let _ = write!(
                out,
                "<path class=\"tick\" d=\"M{at:.1} {top}V{end}\"/><text class=\"{class}\" \
                 x=\"{text_at:.1}\" y=\"{}\">{percent}{unit}</text>",
                end + 14.0
            );
        }
        for (side, letter) in self.sides.iter().zip(["l", "r"]) {
            if let Some(at) = side.foot_off.map(x) {
                let path = format!("M{at:.1} {top}V{end}");
                let _ = write!(out, "<path class=\"off {letter}\" d=\"{path}\"/>");
            }
        }
        out
    }

    /// What the chart shows, in words.
    fn label(&self) -> String {
        let range = |(side, name): (&SideCurve, &str)| match ends(side.mean.iter()) {
            None => format!("{name} not known"),
            Some([low, high]) => format!("{name} mean from {} to {}", short(low), short(high)),
        };
        let [left, right] = [0, 1].map(|i| range((&self.sides[i], ["left", "right"][i])));
        let (title, unit) = (self.title, self.unit);
        format!("{title}, {unit}, over the gait cycle: {left}, {right}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(values: [f64; 4]) -> SideCurve {
        let (name, sd) = ("walk".into(), Some(vec![0.0, 1.0, 1.0, 0.0]));
        let cycle = SingleCycle {
            name,
            values: values.to_vec(),
            sd,
        };
        SideCurve {
            cycles: Vec::from_iter(values[0].is_finite().then_some(cycle)),
            mean: values.to_vec(),
            sd: vec![f64::NAN; 4],
            foot_off: Some(60.0),
        }
    }

    #[test]
    fn an_axis_has_few_round_numbers() {
        let numbers = |ends: [f64; 2], least: f64| {
            let axis = Axis::of(ends, least);
            axis.ticks().map(|t| axis.number(t)).collect::<Vec<_>>()
        };
        assert_eq!(numbers([-3.0, 61.0], 20.0).join(" "), "−20 0 20 40 60 80");
        assert_eq!(
            numbers([0.31, 0.32], 0.4).join(" "),
            "0.1 0.2 0.3 0.4 0.5 0.6"
        );
        assert_eq!(ends([f64::NAN, 1.0, -2.0].iter()), Some([-2.0, 1.0]));
    }

    #[test]
    fn what_is_not_known_is_not_drawn() {
        let chart = |left: [f64; 4], norm| Chart {
            title: "Knee <1>",
            unit: "degrees",
            least: 20.0,
            sides: [side(left), side([f64::NAN; 4])],
            norm,
        };
        let nan = f64::NAN;
        let drawn = chart([1.0, 2.0, nan, 4.0], None).figure(0).unwrap();
        assert!(drawn.contains("Knee &lt;1&gt;") && drawn.contains("right not known"));
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "{drawn}");
        assert_eq!(drawn.matches("class=\"mean").count(), 1);
        assert_eq!(drawn.matches("class=\"doubt l\"").count(), 1);
        assert!(!drawn.contains("class=\"norm\"") && !drawn.contains("class=\"one"));
        let norm = [&[1.0, 2.0, 3.0, 4.0][..], &[1.0; 4]];
        let drawn = chart([1.0; 4], Some(norm)).figure(0).unwrap();
        assert_eq!(drawn.matches("class=\"norm\"").count(), 1);
        assert!(chart([nan; 4], Some(norm)).figure(0).is_none());
    }
}
