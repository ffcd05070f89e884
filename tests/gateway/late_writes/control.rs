//! The control: twenty registers, and something on the way to them.

use std::io::{Result, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;

use crate::late_writes::device::server::{self, Question};

/// Counts of a step: 1 µm in tenths.
pub(crate) const STEP: i16 = 10;
/// The scale of a machine that has one.
pub(crate) const SCALE: usize = 5;

/// The first of its offsets.
const OFFSET: usize = 10;

/// What happens to a write.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Fate {
    /// It is carried out and answered.
    Done,
    /// It is carried out when so much time has passed, and not before the offset of [`Control::comes_over`] stands there;
    /// its answer finds nobody.
    Held(Duration),
    /// It is carried out, and this is answered instead.
    DoneAndDenied(u8),
    /// It is carried out, and five bytes that are no answer come back.
    DoneAndGarbled,
    /// It is carried out, and its answer is lost.
    DoneAndSilent,
    /// It never arrives.
    Lost,
    /// It is carried out, its answer is lost, and before anything else is answered the operator adds so much.
    DoneAndEdited(i16),
}

/// The control.
pub(crate) struct Control {
    pub(crate) words: [u16; 20],
    /// Every offset that stood in its register, in order; and the one of the register beside it.
    pub(crate) stood: Vec<i16>,
    pub(crate) beside: Vec<i16>,
    pub(crate) writes: usize,
    /// What is applied of the offset stands in register 15; this control applies it at once, or never.
    pub(crate) applies: bool,
    /// The offset that a held write wants, from the moment at which the write is held.
    pub(crate) held: Option<i16>,
    /// What a held write changed the offset from and to, when it came.
    pub(crate) late: Option<(i16, i16)>,
    /// What it changed was read: with what is sent again and again it may have changed nothing, or been written over before.
    pub(crate) is_late_read: bool,
    /// What has to stand there before a held write comes.
    pub(crate) comes_over: Option<i16>,
    /// By so much the scale moves before it is read.
    pub(crate) moves: u16,
    /// The two offsets, as they stand in these registers.
    pub(crate) offsets: fn(&[u16]) -> [i16; 2],
    /// What the operator adds while nothing is answered, and when that is over.
    edit: Option<(i16, Moment)>,
    fate: Box<dyn Fn(usize) -> Fate + Send>,
}

/// A control that others look at as well.
pub(crate) type Shared = Arc<Mutex<Control>>;

impl Control {
    /// One whose writes meet these fates, by their number.
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
        let is_late = |(stood, late)| stood != late && (self.offsets)(&self.words)[0] == late;
        let is_late = self.late.is_some_and(is_late);
        self.is_late_read |= is_late && (from..from + count).contains(&OFFSET);
        question.read(&self.words)
    }

    pub(crate) fn apply(&mut self) {
        if self.applies {
            self.words[15] = self.words[10];
        }
    }

    /// The operator changes what stands there by so much. That is no jump of ours.
    pub(crate) fn edits(&mut self, change: i16) {
        self.words[10] = (self.offset() + change).cast_unsigned();
        self.stood = self.stood.iter().map(|stood| stood + change).collect();
    }

    pub(crate) fn offset(&self) -> i16 {
        *self.stood.last().unwrap()
    }

    /// Changes of the offset by more than a step, from and to.
    pub(crate) fn jumps(&self) -> Vec<(i16, i16)> {
        jumps(&self.stood)
    }

    #[track_caller]
    pub(crate) fn never_jumped(&self) {
        for stood in [&self.stood, &self.beside] {
            assert_eq!(jumps(stood), [], "{stood:?}");
        }
    }

    /// The operator's edit, for which answers wait. Whether it is over.
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

/// Answers on a port of its own.
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
        _ => control.put(from, &words),
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
