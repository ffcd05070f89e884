//! Read requests to any unit of one line, one at a time.

use std::time::Duration;

use crate::clock::Clock;
use crate::discovery::bus::LineAddress;
use crate::fieldbus::dial;
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::trace::{Exchange, ExchangeReceiver, Tap};
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::Register;
use isotherm_profile::{Bus, BusId, Device, DeviceId, Functions, Gateway, Quirks, ReadBy};

/// Number of attempts to connect before a read fails because of the connection.
const DIALS: u32 = 3;
const BETWEEN_DIALS: Duration = Duration::from_millis(300);

/// Callback that receives each request with its answer, for a log.
pub type Trace = fn(&Exchange);

/// Sends read requests to the units of a line.
pub struct UnitReader {
    /// Line of the units; `None` for a CAN bus, which has no registers.
    line: Option<DeviceLine>,
    trace: Option<(ExchangeReceiver, Trace)>,
}

impl UnitReader {
    /// Returns a reader for the units at this address. The reader connects with its first read. It uses the settings of
    /// `bus`, for example the timeout, and `quirks` for every unit. `trace` receives every exchange.
    pub fn new(line: &LineAddress, bus: &Bus, quirks: Quirks, trace: Option<Trace>) -> UnitReader {
        let bus = Bus { transport: line.transport, address: line.address.clone(), ..bus.clone() };
        // This line queries all unit numbers, so their number does not indicate a Modbus gateway.
        let quirks = match quirks.gateway {
            Gateway::ByUnits => Quirks { gateway: Gateway::Absent, ..quirks },
            _ => quirks,
        };
        let device = |unit| Device {
            label: String::new(),
            name: format!("unit{unit}"),
            bus: BusId(0),
            unit,
            every: Duration::from_secs(1),
            functions: Functions {
                write_coil: false,
                write_single: false,
                write_coils: false,
                write_multiple: false,
                ..Functions::ALL
            },
            quirks,
            template: None,
            can: None,
            source_time: None,
            is_pc: false,
            read: ReadBy::Poll,
            verify: Vec::new(),
        };
        let devices: Vec<Device> = (0..=u8::MAX).map(device).collect();
        let units: Vec<(DeviceId, &Device)> =
            devices.iter().map(|device| (DeviceId(usize::from(device.unit)), device)).collect();
        let tap = Tap::default();
        let line = dial(&bus).map(|dial| {
            let line = DeviceLine::new(&bus, &units, dial, &Clock::wall()).tapped(&tap);
            line.renewed_after_timeouts()
        });
        UnitReader { line, trace: trace.and_then(|show| Some((tap.listen(None).ok()?, show))) }
    }

    /// Makes the reader keep the connection after a timeout, as the gateway does. By default, a reader closes the
    /// connection, because most of the units that a scan queries do not exist.
    pub fn keeping(mut self) -> UnitReader {
        self.line = self.line.map(DeviceLine::kept_after_timeouts);
        self
    }

    /// Closes the connection. The next read opens another connection.
    pub fn hang_up(&mut self) {
        self.line.iter_mut().for_each(DeviceLine::hang_up);
    }

    /// Returns whether the last request came back as an echo, and nothing else arrived before the timeout. Returns
    /// `false` if the connection was closed after the timeout, for example after two timeouts in a row.
    pub fn has_come_back(&mut self) -> bool {
        self.line.as_mut().is_some_and(DeviceLine::has_come_back)
    }

    /// Reads registers or bits of a unit. If the line cannot connect, the reader tries three times in total.
    ///
    /// # Errors
    /// The reason why there is no valid answer.
    pub async fn read(&mut self, unit: u8, from: Register, count: u16) -> Result<Answer, Fault> {
        let line = self.line.as_mut().ok_or(Fault::Caller(CallerFault::Function))?;
        let mut dials = 1;
        loop {
            // Skip the back-off: the caller waits for the answer.
            let device = DeviceId(usize::from(unit));
            line.revive(None);
            let request = Request::read_registers(from, count);
            let answer = line.request(device, request, SendDeadline::None).await.map(|found| found.answer);
            if let Some((listening, show)) = &mut self.trace {
                std::iter::from_fn(|| listening.next_now()).for_each(|exchange| show(&exchange));
            }
            match answer {
                Err(fault) if fault.is_of_the_line() && dials < DIALS => {
                    dials += 1;
                    tokio::time::sleep(BETWEEN_DIALS).await;
                }
                answer => return answer,
            }
        }
    }
}
