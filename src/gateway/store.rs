//! Data on disk: the state document (saved state and register ledger), the logs, and the saved registers and
//! addresses of outputs and signals.

pub mod backup;
pub mod candidates;
pub(super) mod default_limits;
pub(super) mod disk;
pub(super) mod documents;
pub(super) mod ledger;
pub mod log;
pub(super) mod memory;
pub(super) mod places;
pub(super) mod release;
pub(super) mod storage;
pub mod templates;
