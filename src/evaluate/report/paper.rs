//! The figures of Lai, Yuen, Lee and Lai, "Posing by sparse coding", Tables 1 to 4: mean squared errors in asf² on a random
//! half of the frames, as printed (with the lost digits of the print: see [`Printed::Partial`]).

use crate::evaluate::benchmark::task::Task;

/// A model of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// As the paper calls it.
    pub name: &'static str,
    /// The method here that is the same.
    pub here: &'static str,
}

/// The paper's models, in the order of its tables. Its own is here with plain OMP, as it says.
pub const MODELS: [Model; 7] = [
    of("Our model", OURS),
    of("MFA", "mfa"),
    of("Gaussian", "gaussian"),
    of("LPCA", "lpca"),
    of("CG", "clustered"),
    of("SIK", "sik"),
    of("PCA", "pca"),
];
/// The paper's own model as published.
pub const OURS: &str = "ksvd-omp";
/// Rows that the paper does not have: its model with the better pursuit, and this project's, without and with the outliers
/// it finds and the rigid distances it keeps.
pub const MORE: [Model; 3] = [
    of("Our model, optimised OMP", "ksvd"),
    of("The default model's poses alone", "multiscale"),
    of("The default model here", "multiscale+treated"),
];

const fn of(name: &'static str, here: &'static str) -> Model {
    Model { name, here }
}

/// A figure of the paper's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Printed {
    /// As printed.
    Whole(f64),
    /// A digit is lost in print (".28", "09"): what is left of it. Nothing is concluded from it.
    Partial(&'static str),
    /// No figure is given.
    Absent,
}

use Printed::{Absent, Partial, Whole};

impl Printed {
    /// The figure, where it is whole.
    pub fn value(self) -> Option<f64> {
        match self {
            Whole(v) => Some(v),
            _ => None,
        }
    }

    /// As it is shown.
    pub fn text(self) -> String {
        match self {
            Whole(v) => format!("{v:.2}"),
            Partial(text) => format!("{text}?"),
            Absent => "–".into(),
        }
    }
}

/// A line of the paper's tables 2 to 4.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// CMU's subject.
    pub subject: &'static str,
    /// By [`MODELS`].
    pub errors: [Printed; 7],
}

/// A table of the paper's.
#[derive(Debug, Clone, Copy)]
pub struct Table {
    /// Its number.
    pub number: usize,
    /// The task.
    pub task: Task,
    /// The subjects.
    pub lines: [Line; 4],
}

/// Table 1: all of CMU's database, 2,075,280 test poses; by task, then by [`MODELS`] (SIK was left out there).
pub const TABLE_1: [(Task, [Printed; 7]); 3] = [
    (
        Task::Dense,
        [
            Whole(0.12),
            Whole(0.26),
            Whole(0.25),
            Whole(0.20),
            Whole(0.95),
            Absent,
            Whole(3.34),
        ],
    ),
    (
        Task::Sparse,
        [
            Whole(0.05),
            Whole(0.15),
            Whole(0.14),
            Whole(1.02),
            Whole(0.17),
            Absent,
            Whole(1.36),
        ],
    ),
    (
        Task::Complete,
        [
            Whole(0.01),
            Whole(0.24),
            Whole(0.30),
            Whole(0.80),
            Whole(0.20),
            Absent,
            Absent,
        ],
    ),
];

const fn whole(subject: &'static str, v: [f64; 7]) -> Line {
    Line {
        subject,
        errors: [
            Whole(v[0]),
            Whole(v[1]),
            Whole(v[2]),
            Whole(v[3]),
            Whole(v[4]),
            Whole(v[5]),
            Whole(v[6]),
        ],
    }
}

/// Tables 2 to 4: single subjects. Test poses: 07 2,161; 09 769; 63 7,529; 102 4,252.
pub const TABLES: [Table; 3] = [
    Table {
        number: 2,
        task: Task::Dense,
        lines: [
            whole("07", [0.02, 0.13, 0.08, 0.07, 0.02, 0.70, 0.07]),
            whole("09", [0.03, 0.08, 0.10, 0.06, 0.06, 1.26, 0.09]),
            whole("63", [0.07, 0.41, 2.44, 0.35, 0.34, 3.90, 0.41]),
            Line {
                subject: "102",
                errors: [
                    Whole(0.10),
                    Whole(1.39),
                    Whole(0.17),
                    Whole(0.08),
                    Whole(0.11),
                    Whole(1.37),
                    Partial(".28"),
                ],
            },
        ],
    },
    Table {
        number: 3,
        task: Task::Sparse,
        lines: [
            whole("07", [0.03, 0.08, 0.05, 0.07, 0.19, 0.26, 0.08]),
            whole("09", [0.04, 0.05, 0.06, 0.06, 0.05, 0.70, 0.05]),
            whole("63", [0.03, 0.12, 0.47, 0.09, 0.10, 0.99, 0.36]),
            Line {
                subject: "102",
                errors: [
                    Whole(0.05),
                    Whole(0.08),
                    Whole(0.09),
                    Whole(0.07),
                    Whole(0.08),
                    Partial(".34"),
                    Partial("09"),
                ],
            },
        ],
    },
    Table {
        number: 4,
        task: Task::Complete,
        lines: [
            whole("07", [0.07, 0.11, 0.23, 0.25, 0.95, 0.31, 0.07]),
            whole("09", [0.09, 0.09, 0.26, 0.26, 0.25, 0.74, 0.05]),
            whole("63", [0.07, 0.18, 0.26, 0.18, 0.21, 3.90, 0.53]),
            Line {
                subject: "102",
                errors: [
                    Whole(0.09),
                    Whole(0.24),
                    Whole(0.28),
                    Whole(0.25),
                    Whole(0.27),
                    Whole(1.48),
                    Partial(".30"),
                ],
            },
        ],
    },
];

/// The figure of Table 1.
pub fn at_large(task: Task, model: usize) -> Printed {
    let row = TABLE_1.iter().find(|(t, _)| *t == task);
    row.map_or(Absent, |(_, errors)| errors[model])
}

/// The figure of Tables 2 to 4.
pub fn at_small(task: Task, subject: &str, model: usize) -> Printed {
    let table = TABLES.iter().find(|t| t.task == task);
    let line = table.and_then(|t| t.lines.iter().find(|l| l.subject == subject));
    line.map_or(Absent, |l| l.errors[model])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::benchmark::method::Method;

    #[test]
    fn figures_are_found_and_models_are_there() {
        assert_eq!(at_large(Task::Dense, 0), Whole(0.12));
        assert_eq!(at_large(Task::Complete, 6), Absent);
        assert_eq!(at_small(Task::Complete, "07", 4), Whole(0.95));
        assert_eq!(at_small(Task::Dense, "102", 6).text(), ".28?");
        assert_eq!(at_small(Task::Dense, "01", 0).text(), "–");
        for model in MODELS.iter().chain(&MORE) {
            Method::parse(model.here).unwrap();
        }
    }
}
