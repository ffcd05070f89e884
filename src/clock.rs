//! Time: the wall's, or a virtual one. The only place that knows which.
//!
//! Every task that acts by the clock holds a [`Sleeper`]. The virtual clock advances only when every sleeper sleeps,
//! and then wakes exactly one: the earliest, and of those due at the same moment the one that joined first. So real
//! sockets are waited for, protocol timeouts stay wall time, and one seed gives the same run at any speed.
//! (tokio's paused clock cannot do this: it runs ahead while a real socket waits.)
//!
//! Whatever makes a sleeper's task act before its time goes through its [`Wakeup`]; a message that a sleeping task
//! would have to notice by itself could be overtaken by the clock. A message that comes through
//! the kernel and that no task answers has no sender to wake the sleeper: its reader keeps an [`Inlet`].

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use isotherm_core::quantity::{Moment, Shift, Shifted};

mod alarm;
mod inlet;
mod looks;
mod passing;
mod patience;
mod silence;
mod simulated;
mod stamp;
mod wall;
mod zone;

pub use inlet::{Inlet, Taking};
pub use looks::Looks;
pub use passing::Passing;
pub use patience::Patience;
pub use silence::Silence;
pub use stamp::{Correction, SMALLEST_CORRECTION, Synchronised};
pub use wall::TimeOfDay;
pub use zone::zone;

use alarm::{Alarm, FAR};
use simulated::Simulated;
use stamp::Followed;
use wall::Wall;

/// A clock that tasks share.
#[derive(Clone, Debug)]
pub struct Clock {
    source: Source,
    followed: Arc<Followed>,
    /// How far the time of day of a virtual clock is from what it counts.
    set_to: Arc<Followed>,
}

#[derive(Clone, Debug)]
enum Source {
    Wall(Arc<Wall>),
    Simulated(Arc<Simulated>),
}

/// One task's hold on the clock.
#[derive(Debug)]
pub struct Sleeper {
    clock: Clock,
    place: Place,
}

#[derive(Debug)]
enum Place {
    /// What wakes it before its time, and what wakes it at one that is far away, once there was one.
    Wall(Arc<tokio::sync::Notify>, Option<Alarm>),
    Simulated(simulated::Membership),
}

/// Wakes one sleeper before its time, from any thread.
#[derive(Clone, Debug)]
pub struct Wakeup(WakeupOf);

#[derive(Clone, Debug)]
enum WakeupOf {
    Wall(Arc<tokio::sync::Notify>),
    Simulated(simulated::Wakeup),
}

/// Keeps a virtual clock from advancing while a run is being set up.
#[derive(Debug)]
pub struct Hold {
    _membership: Option<simulated::Membership>,
}

impl Clock {
    /// The wall's time. Anchored once; from there it counts what passes, a computer's suspension included.
    pub fn wall() -> Clock {
        Clock::wall_by(Passing::default(), TimeOfDay::default())
    }

    /// The wall's time as these count it, and say it.
    pub fn wall_by(passing: Passing, time_of_day: TimeOfDay) -> Clock {
        let clock = Clock::of(Source::Wall(Arc::new(Wall::start(passing, time_of_day))));
        // How far apart the two begin is no correction.
        clock.look_at_the_time_of_day();
        clock
    }

    /// A wall's time that is `anchor` now, right or wrong, and goes on as this counts it.
    pub fn set_to(anchor: Moment, passing: Passing) -> Clock {
        let (started, day) = (passing.passed(), passing.clone());
        let time_of_day = move || anchor.after(day.passed().saturating_sub(started));
        Clock::wall_by(passing, TimeOfDay::by(time_of_day))
    }

    fn of(source: Source) -> Clock {
        Clock { source, followed: Arc::default(), set_to: Arc::default() }
    }

    /// What brings a counted moment to the time of day, as that was when it was looked at last.
    pub fn shift(&self) -> Shift {
        self.followed.shift()
    }

    /// A moment as people read it.
    pub fn stamp(&self, moment: Moment) -> Moment {
        moment.shifted(self.shift())
    }

    /// The present moment as people read it.
    pub fn time_of_day(&self) -> Moment {
        self.stamp(self.now())
    }

    /// Looks whether the computer's clock says what it should. Stamps follow it.
    pub fn look_at_the_time_of_day(&self) -> Option<Correction> {
        match &self.source {
            Source::Wall(wall) => self.followed.look(wall.now(), wall.time_of_day.now()),
            Source::Simulated(simulated) => {
                let now = simulated.now();
                self.followed.look(now, now.shifted(self.set_to.shift()))
            }
        }
    }

    /// Sets the time of day of a virtual clock, as a person or a network sets a computer's.
    pub fn set_time_of_day(&self, time_of_day: Moment) {
        if let Source::Simulated(_) = &self.source {
            self.set_to.follow(Shift::between(self.now(), time_of_day));
        }
    }

    /// Its time passes only as its sleepers sleep: it never stands still, and nothing comes too late.
    pub fn is_virtual(&self) -> bool {
        matches!(self.source, Source::Simulated(_))
    }

    /// A virtual time that begins at `start` and runs at most `speed` times as fast as the wall; `None`: as fast as
    /// its sleepers allow.
    pub fn simulated(start: Moment, speed: Option<f64>) -> Clock {
        Clock::of(Source::Simulated(Simulated::start(start, speed)))
    }

    /// The present moment.
    pub fn now(&self) -> Moment {
        match &self.source {
            Source::Wall(wall) => wall.now(),
            Source::Simulated(simulated) => simulated.now(),
        }
    }

    /// A hold for one more task. Join before the task is started, in the order in which simultaneous sleepers shall
    /// act.
    pub fn join(&self) -> Sleeper {
        let place = match &self.source {
            Source::Wall(_) => Place::Wall(Arc::default(), None),
            Source::Simulated(simulated) => Place::Simulated(simulated.sit_down()),
        };
        Sleeper { clock: self.clone(), place }
    }

    /// Stops a virtual clock until the hold is dropped.
    pub fn hold(&self) -> Hold {
        match &self.source {
            Source::Wall(_) => Hold { _membership: None },
            Source::Simulated(simulated) => Hold { _membership: Some(simulated.sit_down()) },
        }
    }

    /// Moves a virtual clock ahead at once, as a suspended computer finds it on waking. The wall's is not moved.
    pub fn skip(&self, span: Duration) {
        if let Source::Simulated(simulated) = &self.source {
            simulated.skip(span);
        }
    }
}

impl Sleeper {
    /// The present moment.
    pub fn now(&self) -> Moment {
        self.clock.now()
    }

    /// The clock it belongs to.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// What wakes this sleeper before its time.
    pub fn wakeup(&self) -> Wakeup {
        Wakeup(match &self.place {
            Place::Wall(notify, _) => WakeupOf::Wall(notify.clone()),
            Place::Simulated(membership) => WakeupOf::Simulated(membership.wakeup()),
        })
    }

    /// What has woken it so far is known, and does not keep it from its next sleep; by a virtual clock, which nothing is
    /// gained by, it still does.
    pub fn forget_wakeups(&mut self) {
        if let Place::Wall(notify, _) = &self.place {
            pin!(notify.notified()).enable();
        }
    }

    /// Sleeps until `deadline` or until the next wakeup. A wakeup since the last sleep ends it at once. Returns the
    /// present moment.
    pub async fn sleep_until(&mut self, deadline: Moment) -> Moment {
        self.sleep_from(self.now(), deadline).await
    }

    /// The same for whoever has just looked at the clock.
    pub async fn sleep_from(&mut self, now: Moment, deadline: Moment) -> Moment {
        match &mut self.place {
            Place::Wall(notify, alarm) => {
                if now >= deadline {
                    return now;
                }
                let left = deadline.since(now);
                if left > FAR
                    && alarm.is_none()
                    && let Source::Wall(wall) = &self.clock.source
                {
                    *alarm = wall.alarm();
                }
                match alarm {
                    Some(alarm) if left > FAR => tokio::select! {
                        () = notify.notified() => {}
                        () = alarm.after(left) => {}
                    },
                    _ => _ = tokio::time::timeout(left, notify.notified()).await,
                }
            }
            Place::Simulated(membership) => membership.sleep_until(deadline).await,
        }
        self.clock.now()
    }

    /// Returns after `span`, or as soon as it is woken.
    pub async fn sleep(&mut self, span: Duration) -> Moment {
        let now = self.now();
        self.sleep_from(now, now.after(span)).await
    }
}

impl Wakeup {
    /// Wakes the sleeper, or keeps it from its next sleep.
    pub fn wake(&self) {
        match &self.0 {
            WakeupOf::Wall(notify) => notify.notify_one(),
            WakeupOf::Simulated(wakeup) => wakeup.pull(),
        }
    }
}

#[cfg(test)]
mod tests;
