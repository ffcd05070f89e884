//! Task that advances the plant, and opens and closes listeners by the fault script.

use tokio::sync::{mpsc, oneshot, watch};

use super::TICK;
use super::server::{OpenOrClose, Shared};
use crate::clock::Sleeper;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// Devices of one listener, and the channel by which the plant's task opens and closes this listener.
pub(super) struct ListenerSwitch {
    pub(super) devices: Vec<DeviceId>,
    pub(super) switch: mpsc::Sender<OpenOrClose>,
    pub(super) is_open: bool,
}

/// Runs the task of the plant. At each tick, the task advances the plant, samples the true error, and opens
/// or closes listeners. The error states that a listener has ended.
pub(super) async fn live(
    shared: Shared,
    mut sleeper: Sleeper,
    begin: Moment,
    mut gates: Vec<ListenerSwitch>,
    mut stop: watch::Receiver<bool>,
) -> Result<(), String> {
    loop {
        let now = sleeper.now();
        let refused: Vec<DeviceId> = {
            let mut hardware = shared.hardware();
            hardware.advance_to(now);
            hardware.observe(now);
            hardware.faults.refused(now).collect()
        };
        for gate in &mut gates {
            let shall_be_open = !gate.devices.iter().any(|device| refused.contains(device));
            let turned = gate.turn(shall_be_open).await;
            if *stop.borrow() {
                return Ok(());
            }
            turned?;
        }
        tokio::select! {
            _ = sleeper.sleep_until(now.next_tick(begin, TICK)) => {}
            _ = stop.changed() => return Ok(()),
        }
    }
}

impl ListenerSwitch {
    /// Opens or closes the listener, and waits until that is done. A virtual clock does not advance during this time.
    async fn turn(&mut self, shall_be_open: bool) -> Result<(), String> {
        if self.is_open == shall_be_open {
            return Ok(());
        }
        let (done, is_done) = oneshot::channel();
        let sent = self.switch.send(OpenOrClose { is_open: shall_be_open, done }).await;
        if sent.is_err() || is_done.await.is_err() {
            return Err("a listener is gone".to_owned());
        }
        self.is_open = shall_be_open;
        Ok(())
    }
}
