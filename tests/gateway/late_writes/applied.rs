//! Value that the control reports as applied.

use std::time::Duration;

use crate::late_writes::control::{Control, Fate};
use crate::late_writes::device::gateway::{events, reported, wait_until};
use crate::late_writes::rig::{beside, nobody_is_blamed, profile_of};

const APPLIED: &str = "read_back = { register = \"holding:15\", tolerance = 0.2, settle = \"200ms\" }\n";

#[test]
fn what_the_control_applies_verifies_a_write_and_what_it_does_not_holds_the_axis() {
    let control = Control::of(|_| Fate::Done);
    let text = profile_of(&control, "2s", APPLIED);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "it walks", |_| seen.lock().unwrap().offset() >= 20);
        seen.lock().unwrap().applies = false;
        wait_until(source, "that is reported", |status| reported(status, "not-applied") == 1);
        wait_until(source, "it holds", |status| status.axes[0].state == "holding");
        let stood = seen.lock().unwrap().offset();
        std::thread::sleep(Duration::from_millis(600));
        assert_eq!(seen.lock().unwrap().offset(), stood, "nothing else is sent");
        let status = source.status();
        let applied = status.outputs[0].applied.unwrap();
        assert!((applied - (f64::from(stood) / 10.0 - 1.0)).abs() < 0.05, "{applied} {stood}");
        seen.lock().unwrap().applies = true;
        seen.lock().unwrap().apply();
        wait_until(source, "it goes on", |_| seen.lock().unwrap().offset() == 50);
    });
    nobody_is_blamed(&control, &status, "applied");
    let texts = events(&status);
    let words = "but the control applies";
    assert!(texts.iter().any(|text| text.contains(words) && text.contains("holding:15")), "{texts:#?}");
    assert_eq!((reported(&status, "not-applied"), reported(&status, "verified")), (1, 1), "{texts:#?}");
}
