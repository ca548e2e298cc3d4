//! Sparse coding: a pose as a sum of a few atoms of a dictionary, and dictionaries learned from
//! poses.
//!
//! | file | content |
//! |---|---|
//! | `dictionary` | unit-norm atoms in rows |
//! | `omp` | parameters of matching pursuit |
//! | `code`, `codes` | the sparse code of one pose, of many poses |
//! | `encoder` | codes many poses on all threads |
//! | `omp_dense`, `omp_indexed` | matching pursuit by a scan of all atoms, and by an index |
//! | `index` | finds the best atom of a pose |
//! | `active_set`, `incremental_qr` | least squares on the chosen atoms, one atom at a time |
//! | `weighted_dictionary` | a dictionary reweighted for poses that share their weights |
//! | `ksvd`, `checkpoint` | dictionary learning, and the state it can resume from |
//! | `initialize`, `atom_update`, `rank_one_svd`, `atom_replacement`, `support_reuse` | K-SVD |
//! | `dictionary_size` | the number of atoms that a target error needs |
//! | `merge`, `coherence` | joins dictionaries and drops near duplicates |

mod active_set;
mod atom_replacement;
mod atom_update;
pub(crate) mod checkpoint;
pub(crate) mod code;
pub(crate) mod codes;
mod coherence;
pub(crate) mod dictionary;
pub(crate) mod dictionary_size;
mod encoder;
mod incremental_qr;
mod index;
mod initialize;
pub(crate) mod ksvd;
pub(crate) mod merge;
pub(crate) mod omp;
mod omp_dense;
mod omp_indexed;
mod rank_one_svd;
mod support_reuse;
#[cfg(test)]
mod testdata;
pub(crate) mod weighted_dictionary;

pub use checkpoint::{IterationStats, TrainingState};
pub use code::{SparseCode, refit};
pub use codes::{SparseCodes, UNUSED};
pub use dictionary::Dictionary;
pub use dictionary_size::{GrowthResult, GrowthSearch, Trial};
pub use encoder::{Encoder, SearchStrategy};
pub use initialize::random_atoms;
pub use ksvd::Ksvd;
pub use merge::{CoherenceStats, DictionaryMerge, MergedDictionary};
pub use omp::{Omp, SelectionRule, StopReason, Tolerance};
pub(crate) use weighted_dictionary::WeightedDictionary;
