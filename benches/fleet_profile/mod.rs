//! Profile of many devices. Each device has its own line, axis and output.

use std::fmt::Write as _;
use std::time::Duration;

/// Registers of a device: seven temperatures and a position.
pub(crate) const REGISTERS: [u16; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Work with many devices.
#[derive(Clone, Copy)]
pub(crate) struct Work {
    pub(crate) devices: u16,
    /// Period of the polls of each device, and of the steps of its axis.
    pub(crate) period: Duration,
    pub(crate) reads_only: bool,
}

/// Returns the keys of the line of a device on this computer. Each device has its own loopback address.
pub(crate) fn tcp(device: u16, port: &str) -> String {
    format!("type = \"modbus-tcp\"\naddress = \"127.0.{}.{}:{port}\"\n", device / 250, device % 250 + 1)
}

impl Work {
    /// Returns the profile. Each read is followed by the write of a corrected position, unless the work only reads.
    /// These registers have a signal; the last one is the position. `line` returns the keys of the line of a device.
    pub(crate) fn profile(&self, registers: &[u16], line: impl Fn(u16) -> String) -> String {
        let period = humantime::format_duration(self.period);
        let timeout = humantime::format_duration(self.period.mul_f64(0.9).min(Duration::from_millis(300)));
        let position = registers.last().unwrap();
        let mut text = String::from("[machine]\nname = \"bench\"\narm = \"auto\"\n");
        for device in 0..self.devices {
            write!(
                text,
                "[bus.b{device}]\n{}timeout = \"{timeout}\"\n\
                 [device.d{device}]\nbus = \"b{device}\"\nunit = 1\nevery = \"{period}\"\n",
                line(device)
            )
            .unwrap();
            for register in registers {
                let (unit, scale) = if register == position { ("mm", 0.01) } else { ("degC", 0.1) };
                write!(
                    text,
                    "[signal.s{device}_{register}]\ndevice = \"d{device}\"\nregister = \"input:{register}\"\n\
                     type = \"i16\"\nscale = {scale}\nunit = \"{unit}\"\nmax_age = \"5s\"\n"
                )
                .unwrap();
            }
            write!(
                text,
                "[axis.z{device}]\nlimit = 40.0\nstep = 5.0\nrate = 20.0\nevery = \"{period}\"\n\
                 on_fault = {{ action = \"hold\" }}\n[[axis.z{device}.model]]\nname = \"difference\"\nkind = \"linear\"\n\
                 terms = [ {{ signal = \"s{device}_0\", gain = 2.4, reference = 0.0 }}, \
                 {{ signal = \"s{device}_1\", gain = -2.4, reference = 0.0 }} ]\n"
            )
            .unwrap();
            if self.reads_only {
                continue;
            }
            write!(
                text,
                "[output.o{device}]\naxis = \"z{device}\"\ndevice = \"d{device}\"\nregister = \"holding:10\"\n\
                 type = \"i16\"\nverify = \"echo\"\nwrites = \"corrected\"\nposition = \"s{device}_{position}\"\n\
                 scale = 0.01\n"
            )
            .unwrap();
        }
        text
    }
}
