//! Data on disk: state and ledger in one document, logs, and the places of outputs and signals by name.

pub mod backup;
pub(super) mod disk;
pub(super) mod documents;
pub(super) mod ledger;
pub mod log;
pub(super) mod memory;
pub(super) mod places;
pub(super) mod release;
pub(super) mod storage;
pub mod templates;
