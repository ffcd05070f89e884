//! Release of a register that no longer belongs to an output: its return to the base value. The module contains the
//! saved state of a release, the values from which a release may continue, and its duration.
//!
//! The gateway changes the register in steps, with the same controller as for an output. This module only decides
//! whether the gateway may change the value that it has read. Any other value may be the operator's. The base value of
//! a register is its value without the gateway's offset: zero, the bias, or the operator offset.
//!
//! | stage | accepted value |
//! |---|---|
//! | any | the base value |
//! | [`Stage::Asked`] | the value that the operator has seen, or up to one step nearer to the base value |
//! | [`Stage::Begun`] | the last verified value, or up to two steps nearer to the base value: one step verified, one step sent |
//!
//! A release ends with the run of the gateway. The next run reports the register again, with the last verified value.

use serde::{Deserialize, Serialize};

use super::{FormerPlace, OutputPlace};

/// Bounds within which the gateway changes an output. They are stored, so that the register of a removed output can be
/// released.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Maximum absolute value of Cz (the compensation value) that may be written, µm.
    pub limit_um: f64,
    /// Largest change of Cz at one update, µm.
    pub step_um: f64,
    /// Maximum speed at which Cz changes, µm/s.
    pub rate_um_per_s: f64,
    /// Time between two changes of the output, s.
    pub every_s: f64,
    /// Condition in the profile under which the output may be written; `None` if the profile has no such condition.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub when: Option<String>,
    /// Reason why the gateway cannot change the register alone; `None` if the gateway can change it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obstacle: Option<Obstacle>,
}

/// Property of an output that prevents a release: the gateway cannot change the register of the output alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Obstacle {
    /// The control accepts the value only together with the other values of its output set, or after a strobe.
    Set,
    /// The value of the output is not an offset.
    Writes,
    /// The value is not in a Modbus register.
    Address,
    /// The register cannot be read.
    Unread,
}

impl Obstacle {
    /// Returns the obstacle as a text about the register.
    pub fn cause(self) -> &'static str {
        match self {
            Obstacle::Set => {
                "the control accepts the register only together with the other registers of its output set"
            }
            Obstacle::Writes => "the value in the register is not an offset",
            Obstacle::Address => "the value is not in a Modbus register",
            Obstacle::Unread => "the register cannot be read",
        }
    }
}

impl Bounds {
    /// Returns whether each bound is a positive number. Any other value means that someone has edited the stored state.
    pub fn are_sound(&self) -> bool {
        let all = [self.limit_um, self.step_um, self.rate_um_per_s, self.every_s];
        all.iter().all(|bound| bound.is_finite() && *bound > 0.0)
    }

    /// Returns the shortest time in which the register can return from this Cz to its base value, s.
    pub fn seconds(&self, from_um: f64) -> f64 {
        let speed = self.rate_um_per_s.min(self.step_um / self.every_s);
        from_um.abs() / speed
    }
}

/// Progress of the release of a register (see [`Release`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// The operator has requested the release.
    Asked,
    /// The gateway has read the register and may have changed its value.
    Begun,
}

/// Release of a register that no longer belongs to an output, as the operator has requested it, and its progress. The
/// release returns the register to its base value (the value without the gateway's offset).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Release {
    /// Former name of the output.
    pub output: String,
    /// Address of the register, and the meaning of its counts.
    pub place: OutputPlace,
    /// Bounds within which the gateway changes the register.
    pub bounds: Bounds,
    /// Cz of the register that the operator saw when requesting the release, µm.
    pub from_um: f64,
    /// For a shared register: the operator offset that the operator saw when requesting the release, in the unit of the
    /// register.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<f64>,
    /// Last verified Cz in the register, µm.
    pub held_um: f64,
    /// Progress of the release.
    pub stage: Stage,
    /// Operator who requested the release, and the channel of the request.
    pub by: String,
}

impl Release {
    /// Returns whether the gateway may change a register in which it has read the Cz `found_um`, µm. `grain_um`: half a
    /// count of the register, µm.
    pub fn may_move_from(&self, found_um: f64, grain_um: f64) -> bool {
        let steps = match self.stage {
            Stage::Asked => 1.0,
            Stage::Begun => 2.0,
        };
        let (farthest, found) = (self.known_um().abs(), found_um * self.from_um.signum());
        let nearest = (farthest - steps * self.bounds.step_um).max(0.0);
        Release::is_back(found_um, grain_um) || (found <= farthest + grain_um && found >= nearest - grain_um)
    }

    /// Returns the Cz of the gateway that the register is expected to contain, µm.
    pub fn known_um(&self) -> f64 {
        match self.stage {
            Stage::Asked => self.from_um,
            Stage::Begun => self.held_um,
        }
    }

    /// Returns whether the register has its base value: the Cz in the register is zero within half a count (`grain_um`,
    /// µm).
    pub fn is_back(found_um: f64, grain_um: f64) -> bool {
        found_um.abs() <= grain_um
    }

    /// Returns the former place of the output. No axis waits for its confirmation.
    pub fn former(&self) -> FormerPlace {
        let former = FormerPlace::of(self.output.clone(), self.place.clone(), Some(self.held_um));
        FormerPlace { bounds: Some(self.bounds.clone()), ..former }
    }

    /// Returns whether this release is for the output that had this name and place.
    pub fn is_of(&self, output: &str, place: &OutputPlace) -> bool {
        self.output == output && self.place == *place
    }
}

#[cfg(test)]
mod tests {
    use super::super::Owner;
    use super::*;

    fn release(from_um: f64, stage: Stage) -> Release {
        let place = OutputPlace {
            bus: "10.0.0.7:502".to_owned(),
            unit: 1,
            address: "holding:104 (40105)".to_owned(),
            layout: "i32 msw-first".to_owned(),
            scale: 0.1,
            bias: 0,
            share: Owner::Whole,
            writes: "offset".to_owned(),
            axis: "z".to_owned(),
            diameter: false,
        };
        let bounds = Bounds {
            limit_um: 40.0,
            step_um: 1.0,
            rate_um_per_s: 0.25,
            every_s: 2.0,
            when: None,
            obstacle: None,
        };
        let (output, by) = ("cnc_z".to_owned(), "by a test".to_owned());
        Release { output, place, bounds, from_um, operator: None, held_um: from_um, stage, by }
    }

    #[test]
    fn the_register_is_moved_only_from_what_a_person_has_seen_or_what_was_verified_last() {
        let rows = [
            (Stage::Asked, 20.0, true),
            (Stage::Asked, 20.04, true),
            (Stage::Asked, 19.0, true),
            (Stage::Asked, 18.9, false),
            (Stage::Asked, 20.1, false),
            (Stage::Asked, 5.0, false),
            (Stage::Asked, -20.0, false),
            (Stage::Asked, 0.0, true),
            (Stage::Asked, -0.04, true),
            (Stage::Begun, 20.0, false),
            (Stage::Begun, 12.1, false),
            (Stage::Begun, 12.0, true),
            (Stage::Begun, 10.0, true),
            (Stage::Begun, 9.9, false),
            (Stage::Begun, 0.0, true),
            (Stage::Begun, -0.1, false),
            (Stage::Begun, -12.0, false),
        ];
        for (stage, found, may) in rows {
            let way = |sign: f64| Release { held_um: 12.0 * sign, ..release(20.0 * sign, stage) };
            assert_eq!(way(1.0).may_move_from(found, 0.05), may, "{stage:?} {found}");
            assert_eq!(way(-1.0).may_move_from(-found, 0.05), may, "{stage:?} -{found}");
        }
        assert!(Release::is_back(0.04, 0.05) && !Release::is_back(0.1, 0.05));
    }

    #[test]
    fn the_slower_of_rate_and_step_says_how_long_it_takes() {
        let mut bounds = release(20.0, Stage::Asked).bounds;
        assert!((bounds.seconds(-20.0) - 80.0).abs() < 1e-9);
        bounds.rate_um_per_s = 5.0;
        assert!((bounds.seconds(20.0) - 40.0).abs() < 1e-9, "1 µm each 2 s");
        assert!(bounds.are_sound());
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            bounds.step_um = wrong;
            assert!(!bounds.are_sound(), "{wrong}");
        }
    }

    #[test]
    fn every_digit_of_a_release_survives_the_disk() {
        let release = release(-20.000_000_1, Stage::Begun);
        let text = serde_json::to_string(&release).unwrap();
        assert_eq!(serde_json::from_str::<Release>(&text).unwrap(), release);
        assert!(text.contains("\"begun\""), "{text}");
        assert!(!text.contains("obstacle") && !text.contains("when"), "{text}");
    }
}
