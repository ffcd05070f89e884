//! What a control says it applies of an offset: `read_back = { register = "input:12", … }`.

use std::time::Duration;

use super::{Check, Zero};
use crate::place::child;
use crate::raw::{RawOutput, ReadBackValue, WritesWord};
use crate::{Applied, Device, Share};
use isotherm_core::codec::{DataType, Encoding, Scale};

/// How long a control may take to apply a change, where nothing else is said.
const SETTLE: Duration = Duration::from_secs(1);

impl Check<'_> {
    /// `written`: the output's own register and how the value lies in it.
    pub(super) fn applied(
        &mut self,
        path: &str,
        raw: &RawOutput,
        share: Share,
        written: (isotherm_core::codec::Register, &Encoding),
        device: Option<&Device>,
    ) -> Option<Applied> {
        let at = child(path, "read_back");
        let table = match raw.read_back.as_ref()? {
            ReadBackValue::Register(table) => table,
            ReadBackValue::Object(_) => {
                let help = "write read_back = { register = \"input:12\" }, or leave it away: what is written is read back there";
                let device = raw.device.as_deref().unwrap_or_default();
                self.wrong(&at, format!("`{device}` hangs on a Modbus line, and an object is on CAN"), help);
                return None;
            }
        };
        if share == Share::Ledger {
            let message =
                "what the control applies is the sum: it does not say how much of a shared register is ours";
            self.wrong(&at, message, "remove `read_back`, or write share = \"whole\"");
        }
        if raw.writes.is_some_and(|writes| writes != WritesWord::Offset) {
            let message = "only of an offset a control says what it applies";
            self.wrong(&at, message, "remove `read_back`, or write writes = \"offset\"");
        }
        let text = table.register.as_ref().or_else(|| {
            let message = "`register` is missing: where does the control say what it applies?";
            self.missing(&at, "register", message, "write register = \"input:12\"");
            None
        })?;
        let address = self.address(&child(&at, "register"), text)?;
        let (own, encoding) = written;
        if address.table.is_bits() {
            self.wrong(
                &child(&at, "register"),
                "a bit holds no offset",
                "name an input or a holding register",
            );
            return None;
        }
        if address == own {
            let message = "it is the register that is written: that is read back without being told to";
            self.wrong(
                &child(&at, "register"),
                message,
                "remove `read_back`, or name the register of what is applied",
            );
        }
        let data_type = table.kind.map_or(encoding.data_type, DataType::from);
        let word_order = match table.word_order {
            None if table.kind.is_none() => encoding.word_order,
            given => self.word_order(&at, Some(data_type), given)?,
        };
        self.fits(&child(&at, "register"), address, data_type);
        if let Some(device) = device {
            self.readable(&child(&at, "register"), address.table, device);
        }
        let scale = match table.scale {
            Some(scale) if scale == 0.0 || !scale.is_finite() => {
                self.wrong(
                    &child(&at, "scale"),
                    "a count worth nothing says nothing",
                    "write µm per count, as 0.1",
                );
                return None;
            }
            Some(scale) => Scale::of(scale),
            None => encoding.scale,
        };
        let count = encoding.scale.get().abs().max(scale.get().abs());
        let tolerance = match table.tolerance {
            Some(tolerance) if !(tolerance.is_finite() && tolerance > 0.0) => {
                self.wrong(&child(&at, "tolerance"), "a tolerance is more than zero", "write µm, as 0.2");
                return None;
            }
            given => given.unwrap_or(count),
        };
        let settle = self.span(&child(&at, "settle"), table.settle.as_ref(), Zero::Allowed).unwrap_or(SETTLE);
        let byte_swap = table.byte_swap.unwrap_or(encoding.byte_swap);
        let encoding =
            Encoding { data_type, word_order, byte_swap, scale, offset: 0.0, bias: 0, bad: Vec::new() };
        Some(Applied { address, encoding, tolerance, settle })
    }
}
