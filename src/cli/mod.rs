//! What every command shares.
