//! The version that `--version` prints.

/// The package's version, and the short hash of the commit that was built in parentheses: `0.2.0 (abc1234)`. Built outside
/// a checkout, or without git, there is no hash. Only `--version` shows it: pages, models and records hold the package's
/// version alone, so that they stay the same from commit to commit.
pub const VERSION: &str = env!("POSING_VERSION");

#[cfg(test)]
mod tests {
    use super::VERSION;

    #[test]
    fn version_begins_with_that_of_the_package() {
        let commit = VERSION.strip_prefix(env!("CARGO_PKG_VERSION")).unwrap();
        let hash = commit
            .strip_prefix(" (")
            .and_then(|rest| rest.strip_suffix(')'));
        let is_hash = |hash: &str| hash.len() >= 7 && hash.chars().all(|c| c.is_ascii_hexdigit());
        assert!(commit.is_empty() || hash.is_some_and(is_hash), "{VERSION}");
    }
}
