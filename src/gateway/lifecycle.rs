//! Start and stop of the gateway, watchdog, recovery of the saved state, and the handover to another program.

pub(super) mod handover;
pub(super) mod learner;
pub(super) mod options;
pub(super) mod recovered_state;
pub(super) mod shutdown;
pub(super) mod successor;
pub(super) mod systemd;
pub(super) mod watchdog;
