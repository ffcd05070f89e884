//! Requests for sensors of this computer.

use std::fmt;

use crate::fieldbus::listed::Listed;
use isotherm_core::codec::PcSensor;

/// Read of the temperatures of these sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorRequest<'a>(pub &'a [PcSensor]);

/// Formats the request: `read w1:28-0316a2794f01`.
impl fmt::Display for SensorRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "read{}", Listed(self.0))
    }
}
