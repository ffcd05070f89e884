//! Resolves and checks the table `[heartbeat]`.

use super::{Heartbeat, RawHeartbeat};
use crate::DeviceId;
use crate::tables::{Check, KeyContext};

impl RawHeartbeat {
    pub(crate) fn resolve(&self, check: &Check<'_>, at: &KeyContext<'_>) -> Option<Heartbeat> {
        let every = at.key("every").period(self.every);
        let index = at.key("device").named(&check.devices.names, self.device.as_ref());
        let known = check.line_kind(self.device.as_ref());
        if let Some(why) = known.and_then(|kind| kind.only_read) {
            return at
                .key("device")
                .reject(why, "write the name of the device that monitors the gateway, usually the control");
        }
        let address = (known.unwrap_or(check.kinds[0]).heartbeat)(self, at);
        let is_register = address.as_ref().is_some_and(|address| address.register().is_some());
        let device = index.and_then(|index| check.devices.get(index));
        if let Some(device) = device.filter(|_| is_register) {
            device.must_write(&at.key("register"), 1);
        }
        Some(Heartbeat { device: DeviceId(index?), address: address?, every: every? })
    }
}
