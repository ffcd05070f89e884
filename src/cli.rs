//! The verbs.
pub mod replay;
