//! Labeled takes that labels are compared with.

use crate::Result;
use crate::io::MotionFile;
use crate::io::motion_file::ReadRules;
use crate::label::Templates;
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;

/// The flags of commands that check labels.
#[derive(Args, Debug, Clone, Default)]
pub struct LikeArgs {
    /// Compare the labels with those of a labeled take of any format, and name tracks without names
    /// as it does; may be given again, and of three takes or more the odd one out is wrong
    #[arg(long, value_name = "LABELED", help_heading = "Labels")]
    pub like: Vec<PathBuf>,
    /// The labeled takes are of the same person: distances must be the same to 2%, and label puts
    /// right what two of them, or one and the sides of the body, say is exchanged in every frame
    #[arg(long, requires = "like", help_heading = "Labels")]
    pub same_person: bool,
}

/// The flag of commands that put labels right as somebody says.
#[derive(Args, Debug, Clone, Default)]
pub struct ExchangeArgs {
    /// Exchange two points in every frame of takes that have both: LSHO:LELB (may be given again)
    #[arg(
        long,
        value_name = "NAME:NAME",
        value_parser = parse_pair,
        help_heading = "Labels"
    )]
    pub exchange: Vec<[String; 2]>,
}

fn parse_pair(text: &str) -> std::result::Result<[String; 2], String> {
    // A person's name stands before a colon, too: Ann:LSHO:Ann:LELB.
    let colons: Vec<usize> = text.match_indices(':').map(|(at, _)| at).collect();
    let middle = colons
        .get(colons.len() / 2)
        .filter(|_| colons.len() % 2 == 1);
    match middle.map(|at| (&text[..*at], &text[at + 1..])) {
        Some((a, b)) if !a.is_empty() && !b.is_empty() && a != b => Ok([a.into(), b.into()]),
        _ => Err("expected two points such as LSHO:LELB".to_string()),
    }
}

impl LikeArgs {
    /// The takes, read as `rules` say.
    ///
    /// # Errors
    /// Those of reading a file.
    pub fn takes(&self, rules: &ReadRules) -> Result<Vec<MotionFile>> {
        let files = self.like.iter();
        files.map(|path| MotionFile::open_by(path, rules)).collect()
    }

    /// What the takes tell, read as `rules` say.
    ///
    /// # Errors
    /// Those of reading a file; [`crate::Error::Data`]: one has too few labels.
    pub fn templates(&self, rules: &ReadRules) -> Result<Arc<Templates>> {
        self.templates_of(&self.takes(rules)?)
    }

    /// What the takes tell, which were read already.
    ///
    /// # Errors
    /// [`crate::Error::Data`]: one has too few labels.
    pub fn templates_of(&self, takes: &[MotionFile]) -> Result<Arc<Templates>> {
        Templates::learn(takes, self.same_person).map(Arc::new)
    }
}
