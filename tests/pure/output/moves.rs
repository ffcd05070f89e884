//! All events that can happen next in a world.

use isotherm_core::output::{
    Action, ArmState, Condition, Fact, Input, NotSent, SavedOutput, Settings, Verify,
};

use isotherm_core::quantity::Counts;

use super::world::{Broken, NOW, World, holds};

/// Changes of the register since its last read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct SinceRead {
    /// Whether the register has changed, but not by the gateway.
    pub(crate) is_moved: bool,
    /// Whether a late write has arrived.
    pub(crate) has_arrived: bool,
}

/// Name of an event, for messages.
pub(crate) type Name = &'static str;

/// Calls `to` with every possible next world, and with the violation on the way there.
pub(crate) fn each(world: &World, settings: &Settings, to: &mut impl FnMut(Name, World, Broken)) {
    let mut go = |name: Name, change: &mut dyn FnMut(&mut World) -> Broken| {
        let mut next = world.clone();
        let broken = change(&mut next);
        to(name, next, broken);
    };
    let left = world.left;
    match (world.gateway, world.action()) {
        (None, _) => {
            go("start", &mut |next| {
                next.start(settings);
                Ok(())
            });
            if world.held.iter().flatten().next().is_some() {
                go("a second passes while it is dead", &mut |next| next.second(settings, false));
            }
        }
        (Some(_), Action::Read) => {
            go("read", &mut |next| next.answer_read(settings));
            if left.losses > 0 {
                go("the read is not answered", &mut |next| {
                    next.left.losses -= 1;
                    next.give(settings, Fact::NoAnswer)
                });
            }
        }
        (Some(gateway), Action::Keep) => {
            go("kept", &mut |next| {
                next.keep(settings, Some(gateway.state().kept()));
                next.give(settings, Input::OnDisk)
            });
            for is_there in [false, true].into_iter().filter(|_| left.disk > 0) {
                go("the disk says no", &mut |next| {
                    next.left.disk -= 1;
                    next.keep(settings, is_there.then(|| gateway.state().kept()));
                    next.give(settings, Fact::NotKept)
                });
            }
            if left.kills > 0 {
                go("killed when it was kept", &mut |next| {
                    next.keep(settings, Some(gateway.state().kept()));
                    next.kill()
                });
            }
        }
        (Some(_), Action::Write { .. }) => writes(world, settings, &mut go),
        (Some(_), Action::Nothing { .. }) => quiet(world, settings, &mut go),
    }
    anywhere(world, settings, &mut go);
}

type Go<'a> = dyn FnMut(Name, &mut dyn FnMut(&mut World) -> Broken) + 'a;

fn writes(world: &World, settings: &Settings, go: &mut Go<'_>) {
    let left = world.left;
    let value = match world.write(settings) {
        Ok(value) => value.unwrap_or_default(),
        Err(why) => return go("write", &mut |_| Err(why.clone())),
    };
    let excuse = (world.since_read.is_moved, world.since_read.is_moved);
    go("write done", &mut |next| {
        next.deliver(settings, value, excuse)?;
        next.give(settings, Fact::Done { left: NOW })
    });
    if left.losses > 0 {
        go("write done, answer lost", &mut |next| {
            next.left.losses -= 1;
            next.deliver(settings, value, excuse)?;
            next.give(settings, Fact::Unknown { left: NOW })
        });
        go("write lost", &mut |next| {
            next.left.losses -= 1;
            next.give(settings, Fact::Unknown { left: NOW })
        });
    }
    if left.holds > 0 && world.held.contains(&None) {
        go("write held", &mut |next| {
            next.left.holds -= 1;
            next.put_on_hold(value);
            next.give(settings, Fact::Unknown { left: NOW })
        });
        if left.kills > 0 {
            go("write held, killed", &mut |next| {
                next.left.holds -= 1;
                next.put_on_hold(value);
                next.kill()
            });
        }
    }
    if left.late > 0 {
        go("the write is too late", &mut |next| {
            next.left.late -= 1;
            next.give(settings, Input::NotSent(NotSent::TooLate))
        });
    }
    if left.lags > 0 {
        go("write done, applied later", &mut |next| {
            (next.left.lags, next.applied.1) = (left.lags - 1, 2);
            next.deliver(settings, value, excuse)?;
            next.give(settings, Fact::Done { left: NOW })
        });
    }
    if left.refusals > 0 {
        go("write refused", &mut |next| {
            next.left.refusals -= 1;
            next.give(settings, Fact::Refused)
        });
    }
    // If the output cannot be read, only its answers are known.
    if left.ignored > 0 && settings.verify == Verify::Reading {
        go("write acknowledged and ignored", &mut |next| {
            (next.left.ignored, next.since_read.has_arrived) = (left.ignored - 1, true);
            next.give(settings, Fact::Done { left: NOW })
        });
    }
    if left.kills > 0 {
        go("write done, killed", &mut |next| {
            next.deliver(settings, value, excuse)?;
            next.kill()
        });
    }
}

fn quiet(world: &World, settings: &Settings, go: &mut Go<'_>) {
    let left = world.left;
    go("a second", &mut |next| next.second(settings, true));
    if left.stale > 0 {
        go("a second with stale readings", &mut |next| {
            next.left.stale -= 1;
            next.second(settings, false)
        });
    }
    for target in [-settings.limit - Counts(1), Counts::ZERO, settings.limit + Counts(1)] {
        if left.targets > 0 && target != world.wanted {
            go("another target", &mut |next| {
                next.left.targets -= 1;
                next.wanted = target;
                next.second(settings, true)
            });
        }
    }
    let shown = world.shown(settings);
    if shown.is_some_and(|shown| matches!(shown.standing, ArmState::Barred | ArmState::Off)) {
        go("a person decides", &mut |next| next.persons_turn(settings, false).map(|_| ()));
        go("a person decides at once", &mut |next| next.persons_turn(settings, true).map(|_| ()));
    }
    if left.offs > 0 {
        go("off and on again", &mut |next| {
            next.left.offs -= 1;
            (next.order, next.armed) = (None, None);
            next.give(settings, next.demand(None))
        });
    }
    if left.interlocks > 0 && world.interlock == Condition::Met {
        for condition in [Condition::NotMet, Condition::Unknown] {
            go("its interlock opens", &mut |next| {
                (next.left.interlocks, next.interlock) = (left.interlocks - 1, condition);
                next.give(settings, next.demand(None))
            });
        }
    }
    if world.interlock != Condition::Met {
        go("its interlock closes", &mut |next| {
            next.interlock = Condition::Met;
            next.give(settings, next.demand(None))
        });
    }
    if left.beats > 0 {
        go("it goes along with others", &mut |next| {
            next.left.beats -= 1;
            next.goes_along(settings)
        });
    }
    if left.kills > 0 {
        go("stopped", &mut |next| {
            next.left.kills -= 1;
            let kept = next.gateway.as_mut().map(|gateway| gateway.state_mut().end());
            next.keep(settings, kept);
            next.is_gone()
        });
    }
}

fn anywhere(world: &World, settings: &Settings, go: &mut Go<'_>) {
    let left = world.left;
    for (place, held) in world.held.iter().enumerate() {
        let Some(held) = held else { continue };
        // Between the read that shows a restart and its write to disk, a late write may arrive from before. If the
        // process is killed then, the operator offset is unknown.
        if held.is_excused && world.is_restarted && world.lost.is_none() {
            continue;
        }
        go("a held write arrives", &mut |next| {
            next.held[place] = None;
            next.held.sort_by_key(|held| held.map(|held| (held.value, held.age)));
            next.since_read.has_arrived = true;
            next.deliver(settings, held.value, (held.is_excused, held.may_jump))
        });
    }
    if left.kills > 0 && world.gateway.is_some() {
        go("killed", &mut World::kill);
    }
    if left.restarts > 0 && settings.verify == Verify::Reading {
        go("the CNC restarts", &mut |next| {
            next.left.restarts -= 1;
            next.register = Counts::ZERO;
            if settings.is_shared {
                next.lost = next.lost.or(Some(next.his));
                (next.his, next.is_restarted) = (Counts::ZERO, true);
            }
            next.is_moved_by_others();
            Ok(())
        });
        if matches!(world.action(), Action::Nothing { .. }) && world.gateway.is_some() {
            go("the CNC restarts, forgets nothing, and says so", &mut |next| {
                (next.left.restarts, next.is_touched) = (left.restarts - 1, true);
                next.give(settings, Fact::Restarted)
            });
        }
    }
    if left.edits > 0 && may_edit(world) && settings.verify == Verify::Reading {
        for change in [-1, 1, 2].map(Counts) {
            let value = world.register + change;
            let is_avoided = settings.is_shared && settings.is_zero(value);
            if holds(settings, value) && !(is_avoided || is_of_ours(world, settings, value)) {
                go("the operator edits", &mut |next| {
                    (next.left.edits, next.is_touched) = (left.edits - 1, true);
                    next.register = value;
                    next.his = next.his + if settings.is_shared { change } else { Counts::ZERO };
                    Ok(())
                });
            }
        }
    }
    if left.pauses > 0 && world.gateway.is_some() {
        for seconds in [1, settings.late.as_secs() + 1] {
            go("the computer stands still", &mut |next| {
                next.left.pauses -= 1;
                pause(next, settings, seconds)
            });
        }
    }
}

/// Returns whether the operator may edit the register. The operator may not when nothing can be promised:
/// - between a read and the write after it;
/// - while a copy is held, or directly after it arrived;
/// - between a write that was acknowledged and ignored and the next read;
/// - between a restart and the write of its zero to disk.
fn may_edit(world: &World) -> bool {
    let is_writing = matches!(world.action(), Action::Write { .. });
    let is_held = world.held.iter().flatten().next().is_some();
    !(is_writing || is_held || world.since_read.has_arrived || world.is_restarted)
}

/// Returns whether a value of the gateway may still appear, or is promised, or was the value before such a one.
fn is_of_ours(world: &World, settings: &Settings, value: Counts) -> bool {
    let kept = [world.gateway.map(|gateway| gateway.state().kept()), world.disk];
    let is_promised = kept.iter().flatten().any(|kept| kept.promises.iter().any(|one| one.value == value));
    let shown = world.shown(settings);
    let stood = shown.filter(|shown| shown.under_way > 0).and_then(|shown| shown.verified);
    // If the process dies before a value is on disk, only the values on disk are known.
    let is_open = |kept: &SavedOutput| !kept.in_order && kept.promises.iter().any(|one| one.is_under_way);
    let on_disk = world.disk.filter(is_open).and_then(|kept| kept.account);
    let is_on_disk = on_disk.is_some_and(|account| account.base + account.share == value);
    is_promised || is_on_disk || stood.is_some_and(|seen| seen.value == value)
}

fn pause(world: &mut World, settings: &Settings, seconds: u64) -> Broken {
    let action = world.action();
    world.order = None;
    for _ in 0..seconds {
        world.pass(settings);
    }
    world.give(settings, Fact::Paused)?;
    match action {
        Action::Read => world.give(settings, Fact::NoAnswer),
        Action::Write { .. } => world.give(settings, Fact::NotSent),
        Action::Keep => {
            world.keep(settings, world.gateway.map(|gateway| gateway.state().kept()));
            world.give(settings, Input::OnDisk)
        }
        Action::Nothing { .. } => Ok(()),
    }
}

impl World {
    pub(crate) fn kill(&mut self) -> Broken {
        self.left.kills -= 1;
        self.is_gone()
    }

    fn is_gone(&mut self) -> Broken {
        self.gateway = None;
        self.order = None;
        Ok(())
    }
}
