//! One question at a time, to any unit of one line.

use std::time::Duration;

use crate::codec::Address;
use crate::fieldbus::dial;
use crate::fieldbus::error::Fault;
use crate::fieldbus::line::Line;
use crate::fieldbus::trace::{Exchange, Listening, Tap};
use crate::fieldbus::wire::{Answer, Request};
use crate::profile::{Bus, BusId, Device, DeviceId, Functions, Quirks};
use crate::quantity::Moment;
use crate::survey::bus::Place;

/// Attempts to connect before a line is given up, with a pause between two.
const DIALS: u32 = 3;
const BETWEEN_DIALS: Duration = Duration::from_millis(300);
/// Longer than any pause of a line after a failure: whoever asks here wants to know now.
const ANY_PAUSE: Duration = Duration::from_secs(120);

/// Puts questions to the units of a line. Reads only.
pub struct Asker {
    line: Line,
    /// Not the time, which a line only needs for its pauses.
    now: Moment,
    listening: Option<Listening>,
}

impl Asker {
    /// The line at this place, with the timeout and quirks of this bus; not connected yet.
    pub fn new(place: &Place, bus: &Bus, quirks: Quirks) -> Asker {
        let bus = Bus { transport: place.transport, address: place.address.clone(), ..bus.clone() };
        let device = |unit| Device {
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
            verify: Vec::new(),
        };
        let devices: Vec<Device> = (0..=u8::MAX).map(device).collect();
        let units: Vec<(DeviceId, &Device)> =
            devices.iter().map(|device| (DeviceId(usize::from(device.unit)), device)).collect();
        let line = Line::new(&bus, &units, dial(&bus));
        Asker { line, now: Moment::default(), listening: None }
    }

    /// The same, with every exchange to be had from [`Asker::heard`].
    #[must_use]
    pub fn listened_to(mut self) -> Asker {
        let tap = Tap::default();
        self.line = self.line.tapped(&tap);
        self.listening = tap.listen(None).ok();
        self
    }

    /// The next exchange that has not been had yet.
    pub fn heard(&mut self) -> Option<Exchange> {
        self.listening.as_mut()?.next_now()
    }

    /// Reads registers or bits of a unit. Where the line cannot be connected it is tried three times.
    ///
    /// # Errors
    /// Why there is no answer.
    pub async fn read(&mut self, unit: u8, from: Address, count: u16) -> Result<Answer, Fault> {
        let mut dials = 1;
        loop {
            self.now = self.now.after(ANY_PAUSE);
            let device = DeviceId(usize::from(unit));
            let answer = self.line.call(device, Request::Read { from, count }, self.now).await;
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
