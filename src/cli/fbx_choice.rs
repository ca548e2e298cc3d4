//! The flags that choose a take and a skeleton of an FBX file.

use crate::io::motion_file::ReadOptions;
use clap::Args;

/// Which of several takes and skeletons is meant.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Input")]
pub struct FbxChoiceArgs {
    /// Take of an FBX file that has several: the name of its animation stack
    #[arg(long, value_name = "NAME")]
    pub take: Option<String>,
    /// Skeleton of an FBX file that has several: the name of its root joint; of roots that are
    /// called alike, of the node above
    #[arg(long, value_name = "NAME")]
    pub skeleton: Option<String>,
}

impl FbxChoiceArgs {
    /// Options that choose so.
    pub fn chosen(&self, options: ReadOptions) -> ReadOptions {
        ReadOptions {
            take: self.take.clone(),
            skeleton: self.skeleton.clone(),
            ..options
        }
    }
}
