//! Catches panics of code that does not belong to the project. A library that reads a file format or communicates with
//! another computer may panic on unexpected input. The caller reports such a panic as an error in the file or of the
//! other computer. The standard panic message is not printed.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Whether this thread is inside [`beyond`], and therefore runs code from outside the project.
    static BEYOND: Cell<bool> = const { Cell::new(false) };
}

/// Error of [`beyond`]: the code from outside the project has panicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Panicked;

/// Runs code from outside the project and catches its panics. Do not run the project's own code with this function: a
/// panic of that code is a defect that must stay visible.
///
/// # Errors
/// The code panicked. Everything that was moved into the closure `run` is lost.
pub fn beyond<T>(run: impl FnOnce() -> T) -> Result<T, Panicked> {
    static SILENCED: Once = Once::new();
    SILENCED.call_once(|| {
        let told = take_hook();
        set_hook(Box::new(move |panic| {
            if !is_beyond() {
                told(panic);
            }
        }));
    });
    let was = BEYOND.replace(true);
    let ran = catch_unwind(AssertUnwindSafe(run));
    BEYOND.set(was);
    ran.map_err(|_| Panicked)
}

/// Returns the message of a panic from its payload, or "panic" if the payload is not text.
pub fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "panic".to_owned())
}

/// Returns whether this thread runs code from outside the project: inside [`beyond`], or in a thread of the ONNX
/// runtime. The names of the runtime's threads begin with `rten-`.
fn is_beyond() -> bool {
    BEYOND.get() || std::thread::current().name().is_some_and(|name| name.starts_with("rten-"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_beyond_the_border_is_an_error_and_the_next_one_is_too() {
        assert_eq!(beyond(|| 7), Ok(7));
        for _ in 0..2 {
            assert_eq!(beyond(|| -> u8 { panic!("a length below zero") }), Err(Panicked));
            assert!(!BEYOND.get(), "a panic of our own is shown again");
        }
        let panic = std::thread::spawn(|| -> u8 { panic!("no {}", 7) }).join().unwrap_err();
        assert_eq!(panic_message(panic.as_ref()), "no 7");
        let inner = beyond(|| (beyond::<()>(|| panic!("deeper")), BEYOND.get()));
        assert_eq!(inner, Ok((Err(Panicked), true)));
    }
}
