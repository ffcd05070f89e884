//! An operator's register, of which we own a share: what must be known of it.

use std::time::Duration;

use super::Check;
use crate::place::child;
use crate::raw::{RawOutput, ShareWord, VerifyWord, WritesWord};
use crate::{Device, Share};
use isotherm_core::codec::{DataType, Table};

impl Check<'_> {
    pub(super) fn share(
        &mut self,
        path: &str,
        raw: &RawOutput,
        data_type: DataType,
        device: Option<&Device>,
    ) -> Share {
        if raw.share != Some(ShareWord::Ledger) {
            return Share::Whole;
        }
        let at = child(path, "share");
        if raw.verify == Some(VerifyWord::Echo) {
            let message = "a share is known only from what is read: verify = \"echo\" does not do for share = \"ledger\"";
            self.wrong(&child(path, "verify"), message, "remove `verify`, or write verify = \"read-back\"");
            // Else the check of the read-back says so.
            if device.is_some_and(|device| !device.functions.reads(Table::Holding)) {
                let message = "a share is known only from what is read, and the device cannot be read";
                let help = "add \"read-holding\" to `functions` of the device, if the device can do it";
                self.wrong(&at, message, help);
            }
        }
        if raw.writes.is_some_and(|writes| writes != WritesWord::Offset) {
            let message = "only an offset can share its register with an operator";
            self.wrong(&at, message, "write writes = \"offset\", or share = \"whole\"");
        }
        if !matches!(data_type, DataType::I16 | DataType::U16 | DataType::I32 | DataType::U32) {
            let message = format!(
                "{} holds no exact sum of two parts: a share is counted in whole counts of at most 32 bits",
                data_type.name()
            );
            self.wrong(
                &at,
                message,
                "take type = \"i16\", \"u16\", \"i32\" or \"u32\", or share = \"whole\"",
            );
        }
        Share::Ledger
    }

    /// An operator's register is looked at as often as its axis decides, and never written again with what stands there.
    pub(super) fn refresh_of(
        &mut self,
        path: &str,
        share: Share,
        refresh: Option<Duration>,
    ) -> Option<Duration> {
        if share == Share::Ledger && refresh.is_some() {
            let message = "a shared register is not refreshed: to write the same again could only undo what an operator does \
                           meanwhile";
            let help = "remove `refresh`: the register is read once in each `every` of its axis all the same";
            self.warnings.push(self.places.at_key(&child(path, "refresh"), message, Some(help.to_owned())));
        }
        refresh.filter(|_| share == Share::Whole)
    }
}
