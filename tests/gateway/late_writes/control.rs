//! Control with twenty registers, and a faulty path to them.

use std::io::{Result, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;

use crate::late_writes::device::server::{self, Question};

/// Counts of one step: 1 µm in tenths.
pub(crate) const STEP: i16 = 10;
/// Register of the scale of a machine that has one.
pub(crate) const SCALE: usize = 5;

/// Register of the first offset.
const OFFSET: usize = 10;

/// Fate of a write.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Fate {
    /// The write is executed and answered.
    Done,
    /// The write is executed after this time, and not before the register has the offset of [`Control::comes_over`].
    /// Its answer reaches no client.
    Held(Duration),
    /// The write is executed, and this exception is answered.
    DoneAndDenied(u8),
    /// The write is executed, and five bytes that are no answer are sent.
    DoneAndGarbled,
    /// The write is executed, and its answer is lost.
    DoneAndSilent,
    /// The write never arrives.
    Lost,
    /// The write is executed, and its answer is lost. Before anything else is answered, the operator adds this to the
    /// value.
    DoneAndEdited(i16),
}

/// Registers of the control, and what has happened to them.
pub(crate) struct Control {
    pub(crate) words: [u16; 20],
    /// Every offset that the register has had, in order, and every value of the second offset register.
    pub(crate) stood: Vec<i16>,
    pub(crate) beside: Vec<i16>,
    pub(crate) writes: usize,
    /// Register 15 contains the applied offset. The control applies an offset at once, or never.
    pub(crate) applies: bool,
    /// Offset of a delayed write, as soon as it is delayed.
    pub(crate) held: Option<i16>,
    /// Offset before and after a delayed write, when it arrived.
    pub(crate) late: Option<(i16, i16)>,
    /// The change by the delayed write was read. If values are written repeatedly, it may have changed nothing, or may
    /// have been overwritten before.
    pub(crate) is_late_read: bool,
    /// The delayed write arrived between a read of the client and its next write, which replaced the value unread. No
    /// client can know that value.
    pub(crate) is_late_overwritten: bool,
    /// Offset that the register must have before a delayed write arrives.
    pub(crate) comes_over: Option<i16>,
    /// Movement of the scale before it is read, counts.
    pub(crate) moves: u16,
    /// Decodes the two offsets from the registers.
    pub(crate) offsets: fn(&[u16]) -> [i16; 2],
    /// Change by the operator while nothing is answered, and the end of that time.
    edit: Option<(i16, Moment)>,
    fate: Box<dyn Fn(usize) -> Fate + Send>,
}

/// Control that several threads share.
pub(crate) type Shared = Arc<Mutex<Control>>;

impl Control {
    /// Creates a control. `fate` returns the fate of each write by its number.
    pub(crate) fn of(fate: impl Fn(usize) -> Fate + Send + 'static) -> Shared {
        let mut words = [0; 20];
        words[0] = 250;
        Arc::new(Mutex::new(Control {
            words,
            stood: vec![0],
            beside: vec![0],
            writes: 0,
            applies: true,
            held: None,
            late: None,
            is_late_read: false,
            is_late_overwritten: false,
            comes_over: None,
            moves: 0,
            offsets: |words| [words[10].cast_signed(), words[11].cast_signed()],
            edit: None,
            fate: Box::new(fate),
        }))
    }

    pub(crate) fn put(&mut self, register: u16, words: &[u16]) {
        let from = usize::from(register);
        self.words[from..from + words.len()].copy_from_slice(words);
        let now = (self.offsets)(&self.words);
        for (stood, value) in [&mut self.stood, &mut self.beside].into_iter().zip(now) {
            if stood.last() != Some(&value) {
                stood.push(value);
            }
        }
        self.apply();
    }

    pub(crate) fn read(&mut self, question: &Question) -> Vec<u8> {
        let (from, count) = (usize::from(question.from()), usize::from(question.count()));
        if (from..from + count).contains(&SCALE) {
            self.words[SCALE] = (self.words[SCALE] + self.moves) % 1000;
        }
        self.is_late_read |= self.is_late() && (from..from + count).contains(&OFFSET);
        question.read(&self.words)
    }

    /// Whether the offset is that of the delayed write, which has changed it.
    fn is_late(&self) -> bool {
        self.late.is_some_and(|(stood, late)| stood != late && (self.offsets)(&self.words)[0] == late)
    }

    /// Executes a write of the client that is neither lost nor delayed.
    fn write(&mut self, register: u16, words: &[u16]) {
        let was_late = self.is_late();
        self.put(register, words);
        self.is_late_overwritten |= was_late && !self.is_late_read && !self.is_late();
    }

    pub(crate) fn apply(&mut self) {
        if self.applies {
            self.words[15] = self.words[10];
        }
    }

    /// Changes the register value by an edit of the operator. That is no jump of the gateway.
    pub(crate) fn edits(&mut self, change: i16) {
        self.words[10] = (self.offset() + change).cast_unsigned();
        self.stood = self.stood.iter().map(|stood| stood + change).collect();
    }

    pub(crate) fn offset(&self) -> i16 {
        *self.stood.last().unwrap()
    }

    /// Changes of the offset by more than one step, from and to.
    pub(crate) fn jumps(&self) -> Vec<(i16, i16)> {
        jumps(&self.stood)
    }

    #[track_caller]
    pub(crate) fn never_jumped(&self) {
        for stood in [&self.stood, &self.beside] {
            assert_eq!(jumps(stood), [], "{stood:?}");
        }
    }

    /// Makes the edit of the operator that is due. Returns whether there is none to wait for.
    fn is_edited(&mut self) -> bool {
        if let Some((change, until)) = self.edit {
            if Clock::wall().now() < until {
                return false;
            }
            self.edit = None;
            self.edits(change);
        }
        true
    }
}

pub(crate) fn jumps(stood: &[i16]) -> Vec<(i16, i16)> {
    let pairs = stood.windows(2).map(|pair| (pair[0], pair[1]));
    pairs.filter(|(from, to)| (to - from).abs() > STEP).collect()
}

/// Starts a server for this control on a separate port.
pub(crate) fn serve(control: &Shared) -> SocketAddr {
    let control = control.clone();
    server::serve(move |question: &Question, stream: &mut TcpStream| answer(question, stream, &control))
}

fn answer(question: &Question, stream: &mut TcpStream, shared: &Shared) -> Result<()> {
    let mut control = shared.lock().unwrap();
    if !control.is_edited() {
        return Ok(());
    }
    if question.is_read() {
        let pdu = control.read(question);
        drop(control);
        return stream.write_all(&question.answer(&pdu));
    }
    let (from, words) = (question.from(), question.words());
    let fate = (control.fate)(control.writes);
    control.writes += 1;
    match fate {
        Fate::Lost => return Ok(()),
        Fate::Held(span) => {
            let mut wanted = control.words;
            wanted[usize::from(from)..][..words.len()].copy_from_slice(&words);
            control.held = Some((control.offsets)(&wanted)[0]);
            let shared = shared.clone();
            std::thread::spawn(move || {
                std::thread::sleep(span);
                let is_over = |control: &Control| control.comes_over.is_none_or(|at| control.offset() == at);
                while !is_over(&shared.lock().unwrap()) {
                    std::thread::sleep(Duration::from_millis(20));
                }
                let mut control = shared.lock().unwrap();
                let stood = control.offset();
                control.put(from, &words);
                control.late = Some((stood, control.offset()));
            });
            return Ok(());
        }
        _ => control.write(from, &words),
    }
    let reply = match fate {
        Fate::DoneAndDenied(code) => question.answer(&question.denied(code)),
        Fate::DoneAndGarbled => vec![1, 2, 3, 4, 5],
        Fate::DoneAndSilent => return Ok(()),
        Fate::DoneAndEdited(change) => {
            control.edit = Some((change, Clock::wall().now().after(Duration::from_millis(300))));
            return Ok(());
        }
        Fate::Done | Fate::Held(_) | Fate::Lost => question.answer(&question.done()),
    };
    drop(control);
    stream.write_all(&reply)
}
