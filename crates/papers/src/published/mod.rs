//! Pose models that the default is compared with in papers: the feature `published`. [`register`]
//! makes them known.

pub(crate) mod box_tree;
pub mod gaussian;
pub(crate) mod gplvm;
pub(crate) mod local_pca;
pub(crate) mod nearest_neighbor;

use crate::prior::{KindEntry, registry};
use gaussian::{clustered, mfa, mixture, pca, single};

/// The entry of a kind that has a name, `train` and `open`.
macro_rules! entry {
    ($kind:path, $description:literal) => {
        KindEntry {
            name: $kind.name,
            description: $description,
            train: |poses, options, report| $kind.train(poses, options, report),
            open: |model, options, source| Ok(Box::new($kind.open(model, options, source)?)),
        }
    };
}

static KINDS: [KindEntry; 8] = [
    entry!(nearest_neighbor::KIND, "nearest training pose"),
    entry!(
        local_pca::KIND,
        "local PCA: Gaussian of the 100 nearest training poses"
    ),
    KindEntry {
        name: "sik",
        description: "style-based IK: scaled Gaussian process latent variable model",
        train: gplvm::train,
        open: |model, options, source| {
            Ok(Box::new(gplvm::GplvmPrior::open(model, options, source)?))
        },
    },
    entry!(
        pca::KIND,
        "principal components that keep 90% of the energy"
    ),
    entry!(single::KIND, "a single Gaussian"),
    entry!(
        clustered::KIND,
        "a Gaussian for each of 20 clusters; the most likely one is used"
    ),
    entry!(mfa::KIND, "mixture of 20 factor analyzers"),
    entry!(
        mixture::KIND,
        "mixture of 20 Gaussians with shrunk covariances"
    ),
];

/// Makes the kinds `nearest`, `lpca`, `sik`, `pca`, `gaussian`, `clustered`, `mfa` and `mixture`
/// known to the whole process. The program does so at its start; calls after the first change
/// nothing.
///
/// ```
/// use posing_models::prior::Kind;
/// use posing_papers::published;
///
/// assert!("pca".parse::<Kind>().is_err());
/// published::register();
/// assert_eq!("pca".parse::<Kind>()?.name(), "pca");
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn register() {
    registry::register(&KINDS);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kind_checks;
    use crate::prior::Kind;

    fn kinds() -> [Kind; 8] {
        register();
        KINDS.each_ref().map(Kind::Registered)
    }

    #[test]
    fn kinds_are_registered_once_and_read_back() {
        let kinds = kinds();
        register();
        for kind in kinds {
            assert_eq!(kind.to_string().parse::<Kind>().unwrap(), kind);
            let same = Kind::all().into_iter().filter(|k| *k == kind);
            assert_eq!(same.count(), 1);
        }
    }

    #[test]
    fn files_batches_and_threads_change_no_bit() {
        kind_checks::files_batches_and_threads_change_no_bit(&kinds());
    }

    #[test]
    fn rotated_poses_have_rotated_posteriors() {
        // A GPLVM weighs each axis of the space by a variance of its own.
        let kinds: Vec<Kind> = (kinds().into_iter())
            .filter(|k| k.name() != "sik")
            .collect();
        kind_checks::rotated_poses_have_rotated_posteriors(&kinds);
    }

    #[test]
    fn a_damaged_array_is_an_error_that_names_it() {
        kind_checks::a_damaged_array_is_an_error_that_names_it(&kinds());
    }
}
