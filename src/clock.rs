//! Clocks of the program: wall-clock time, or virtual time in tests and in the demo.
//!
//! A clock counts the time from its start. Counted time does not change if the computer's clock is set. The
//! time of day is counted time plus a difference, and is only for display. Every task that acts at certain
//! times owns a [`Sleeper`]. The virtual clock advances only while every sleeper sleeps. It then wakes
//! exactly one sleeper, which has the earliest deadline. Among equal deadlines, the sleeper that joined first
//! is woken first. A task that waits only for a real socket counts as awake, so that the virtual clock waits
//! too. Protocol timeouts stay in wall-clock time. A run with the same seed has the same result at any speed.
//! (The paused clock of tokio cannot do this: it advances while a real socket waits.)
//!
//! Code that needs an action of a sleeping task before the deadline calls the [`Wakeup`] of the task's
//! sleeper. Without this call, a virtual clock could advance before the task receives its message. The sender
//! of a message through a socket cannot make this call. If such messages get no reply, their reader keeps a
//! [`SocketGate`], which stops the virtual clock until the messages have been read.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use isotherm_core::quantity::{Moment, Shift, Shifted};

mod alarm;
mod boot_clock;
mod silence;
mod simulated;
mod socket_gate;
mod stall_detector;
mod stamp;
mod ticks;
mod wall;
mod wall_timeout;
mod wheel_timer;
mod zone;

pub use boot_clock::BootClock;
pub use silence::Silence;
pub use socket_gate::{ReadGuard, SocketGate};
pub use stall_detector::StallDetector;
pub use stamp::{Correction, SMALLEST_CORRECTION, Synchronised};
pub use ticks::Ticks;
pub use wall::TimeOfDay;
pub use wall_timeout::WallTimeout;
pub use zone::zone;

use alarm::{Alarm, FAR};
use simulated::Simulated;
use stamp::ClockDifference;
use wall::Wall;
use wheel_timer::WheelTimer;

/// Clock that several tasks share. All clones of a clock have the same time and the same sleepers.
#[derive(Clone, Debug)]
pub struct Clock {
    source: Source,
    followed: Arc<ClockDifference>,
    /// For a virtual clock: time of day that a test has set, as a difference from counted time.
    set_to: Arc<ClockDifference>,
}

#[derive(Clone, Debug)]
enum Source {
    Wall(Arc<Wall>),
    Simulated(Arc<Simulated>),
}

/// Registration of one task with the clock, by which the task sleeps until a deadline or an earlier wakeup.
#[derive(Debug)]
pub struct Sleeper {
    clock: Clock,
    place: SleeperKind,
}

#[derive(Debug)]
enum SleeperKind {
    /// Notification that wakes the sleeper early, and the timers of the sleeper. The kernel timer is created for the
    /// first distant deadline.
    Wall(Arc<tokio::sync::Notify>, Option<Alarm>, WheelTimer),
    Simulated(simulated::Membership),
}

/// Handle that wakes one sleeper before its deadline, from any thread.
#[derive(Clone, Debug)]
pub struct Wakeup(WakeupOf);

#[derive(Clone, Debug)]
enum WakeupOf {
    Wall(Arc<tokio::sync::Notify>),
    Simulated(simulated::Wakeup),
}

/// Value that stops a virtual clock until it is dropped, for example while a run is being set up.
#[derive(Debug)]
pub struct Hold {
    _membership: Option<simulated::Membership>,
}

impl Clock {
    /// Returns a clock of wall-clock time. It reads the time of day once, and then counts elapsed time, including any
    /// suspension of the computer.
    pub fn wall() -> Clock {
        Clock::wall_by(BootClock::default(), TimeOfDay::default())
    }

    /// Returns a clock of wall-clock time that takes elapsed time from `boot_clock` and the time of day from
    /// `time_of_day`.
    pub fn wall_by(boot_clock: BootClock, time_of_day: TimeOfDay) -> Clock {
        let clock = Clock::of(Source::Wall(Arc::new(Wall::start(boot_clock, time_of_day))));
        // The first comparison sets the shift. Its difference is not a correction.
        clock.check_time_of_day();
        clock
    }

    /// Returns a wall clock that shows `anchor` now, even if that is not the correct time, and then counts with
    /// `boot_clock`.
    pub fn set_to(anchor: Moment, boot_clock: BootClock) -> Clock {
        let (started, day) = (boot_clock.passed(), boot_clock.clone());
        let time_of_day = move || anchor.after(day.passed().saturating_sub(started));
        Clock::wall_by(boot_clock, TimeOfDay::by(time_of_day))
    }

    fn of(source: Source) -> Clock {
        Clock { source, followed: Arc::default(), set_to: Arc::default() }
    }

    /// Returns the time of day minus counted time, as measured by the last [`Clock::check_time_of_day`].
    pub fn shift(&self) -> Shift {
        self.followed.shift()
    }

    /// Converts a moment of counted time to the time of day, for display.
    pub fn stamp(&self, moment: Moment) -> Moment {
        moment.shifted(self.shift())
    }

    /// Returns the present moment as time of day, for display.
    pub fn time_of_day(&self) -> Moment {
        self.stamp(self.now())
    }

    /// Compares counted time with the computer's time of day. From then on, displayed times follow the time of day.
    /// Returns the correction if the computer's clock was set since the last check.
    pub fn check_time_of_day(&self) -> Option<Correction> {
        match &self.source {
            Source::Wall(wall) => self.followed.check(wall.now(), wall.time_of_day.now()),
            Source::Simulated(simulated) => {
                let now = simulated.now();
                self.followed.check(now, now.shifted(self.set_to.shift()))
            }
        }
    }

    /// Sets the time of day of a virtual clock, as a user or a network time service sets a computer's clock.
    pub fn set_time_of_day(&self, time_of_day: Moment) {
        if let Source::Simulated(_) = &self.source {
            self.set_to.follow(Shift::between(self.now(), time_of_day));
        }
    }

    /// Returns whether this clock is virtual. Virtual time passes only while all sleepers sleep. A busy computer
    /// therefore makes no task late.
    pub fn is_virtual(&self) -> bool {
        matches!(self.source, Source::Simulated(_))
    }

    /// Returns whether many tasks use this clock. The computer is then rarely idle, and an unnecessary wake-up costs
    /// less than setting a timer again.
    pub fn is_busy(&self) -> bool {
        matches!(&self.source, Source::Wall(wall) if wall.is_busy())
    }

    /// Returns a virtual clock that begins at `start`, and runs at most `speed` times as fast as wall-clock time. With
    /// `None`, it runs as fast as the tasks with sleepers allow.
    pub fn simulated(start: Moment, speed: Option<f64>) -> Clock {
        Clock::of(Source::Simulated(Simulated::start(start, speed)))
    }

    /// Returns the present moment in counted time.
    pub fn now(&self) -> Moment {
        match &self.source {
            Source::Wall(wall) => wall.now(),
            Source::Simulated(simulated) => simulated.now(),
        }
    }

    /// Registers one more task, and returns its sleeper. Call this function before the task starts. Sleepers with equal
    /// deadlines act in the order in which they were registered.
    pub fn join(&self) -> Sleeper {
        let place = match &self.source {
            Source::Wall(_) => SleeperKind::Wall(Arc::default(), None, WheelTimer::default()),
            Source::Simulated(simulated) => SleeperKind::Simulated(simulated.sit_down()),
        };
        Sleeper { clock: self.clone(), place }
    }

    /// Stops a virtual clock until the returned value is dropped. A wall clock continues.
    pub fn hold(&self) -> Hold {
        match &self.source {
            Source::Wall(_) => Hold { _membership: None },
            Source::Simulated(simulated) => Hold { _membership: Some(simulated.sit_down()) },
        }
    }

    /// Moves a virtual clock ahead at once, as if the computer had been suspended for `span`. A wall clock is not
    /// changed.
    pub fn skip(&self, span: Duration) {
        if let Source::Simulated(simulated) = &self.source {
            simulated.skip(span);
        }
    }
}

impl Sleeper {
    /// Returns the present moment in counted time.
    pub fn now(&self) -> Moment {
        self.clock.now()
    }

    /// Returns the clock of this sleeper.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Returns a handle that wakes this sleeper early.
    pub fn wakeup(&self) -> Wakeup {
        Wakeup(match &self.place {
            SleeperKind::Wall(notify, ..) => WakeupOf::Wall(notify.clone()),
            SleeperKind::Simulated(membership) => WakeupOf::Simulated(membership.wakeup()),
        })
    }

    /// Discards the wakeups so far, so that they do not end the next sleep. Under a virtual clock this function does
    /// nothing: earlier wakeups still end the next sleep.
    pub fn forget_wakeups(&mut self) {
        if let SleeperKind::Wall(notify, ..) = &self.place {
            pin!(notify.notified()).enable();
        }
    }

    /// Sleeps until `deadline` or until the next wakeup. A wakeup that came after the last sleep ends this sleep at
    /// once. Returns the present moment.
    pub async fn sleep_until(&mut self, deadline: Moment) -> Moment {
        self.sleep_from(self.now(), deadline).await
    }

    /// Sleeps like [`Sleeper::sleep_until`]. The caller has just read the clock, and passes the result as `now`.
    pub async fn sleep_from(&mut self, now: Moment, deadline: Moment) -> Moment {
        match &mut self.place {
            SleeperKind::Wall(notify, alarm, timer) => {
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
                        biased;
                        () = notify.notified() => {}
                        () = alarm.after(left) => {}
                    },
                    _ => tokio::select! {
                        biased;
                        () = notify.notified() => {}
                        () = timer.after(left) => {}
                    },
                }
            }
            SleeperKind::Simulated(membership) => membership.sleep_until(deadline).await,
        }
        self.clock.now()
    }

    /// Sleeps for `span`, or until the next wakeup. Returns the present moment.
    pub async fn sleep(&mut self, span: Duration) -> Moment {
        let now = self.now();
        self.sleep_from(now, now.after(span)).await
    }
}

impl Wakeup {
    /// Wakes the sleeper. If the sleeper is awake, its next sleep ends at once.
    pub fn wake(&self) {
        match &self.0 {
            WakeupOf::Wall(notify) => notify.notify_one(),
            WakeupOf::Simulated(wakeup) => wakeup.pull(),
        }
    }
}

#[cfg(test)]
mod tests;
