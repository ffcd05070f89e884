//! The border to the code of others: a reader of a file format that nobody here has written, or a library that speaks with a peer, may
//! panic at what its authors did not think of. That is the file's or the peer's fault: it ends here, in a sentence, and nothing is printed
//! beside it.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Whether this thread is beyond the border.
    static BEYOND: Cell<bool> = const { Cell::new(false) };
}

/// The code behind the border panicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Panicked;

/// Runs the code of others. Not for code of our own, whose panics are mistakes that somebody must see.
///
/// # Errors
/// It panicked; what it had taken with it is lost.
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

/// What a panic says, of whomever.
pub fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "panic".to_owned())
}

/// The ONNX runtime computes in a thread of its own, which it names.
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
