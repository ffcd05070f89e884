//! A step allocates no memory, whatever its input.

use allocation_counter::measure;
use isotherm_core::output::{Action, Fact, State, Who, step};

use isotherm_core::quantity::Counts;

use super::world::{NOW, settings};

#[test]
fn no_step_allocates() {
    for is_shared in [false, true] {
        let settings = settings(is_shared, 5, 4);
        let mut state = State::new(&settings, None, NOW);
        let mut register = Counts::ZERO;
        let counted = measure(|| {
            let mut fact = Fact::Look;
            for count in 0..400u64 {
                let now = NOW.after(std::time::Duration::from_millis(100 * count));
                let action = step(&mut state, &settings, fact, now);
                assert!(state.take_events().len() < 8);
                fact = match action {
                    Action::Read => Fact::Read { found: register, asked: now },
                    Action::Keep => Fact::Kept,
                    Action::Write { .. } if count % 3 == 0 => Fact::Unknown { left: now },
                    Action::Write { value, .. } => {
                        register = value;
                        Fact::Done { left: now }
                    }
                    Action::Nothing { .. } if count % 2 == 0 => Fact::Armed { by: Who::Person },
                    Action::Nothing { .. } => {
                        Fact::Decided { offset: Counts(5), target: None, not_after: now.after(settings.late) }
                    }
                };
            }
        });
        assert_eq!(counted.count_total, 0);
        assert_ne!(register, Counts::ZERO, "it has written");
    }
}
