//! Expressions a person writes: `Kz * (A - (b*t + c))` for a model, `cnc_on == 1` for a condition.
//!
//! Parsed once into a list of operations on a small stack; evaluating allocates nothing. Operators, weakest
//! first: `or`, `and`, `not`, `== != < <= > >=`, `+ -`, `* /`, unary `-`, `^`. Functions: `abs exp ln sqrt min max`.
//! M2 of JP H07-61598 B2 is the reference case.

use super::{Evaluate, Inputs, Outputs, Unusable};
use crate::reading::SignalId;

mod parser;
#[cfg(test)]
mod tests;

pub use parser::ExpressionError;

/// Deepest nesting an expression may have: the size of the evaluation stack.
const DEPTH: usize = 32;

/// A parsed expression over signals and the time since machine start.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    text: String,
    operations: Vec<Operation>,
}

/// What a name in an expression stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Symbol {
    /// The value of a signal.
    Signal(SignalId),
    /// A number.
    Constant(f64),
    /// The time since machine start in seconds.
    Time,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Operation {
    Push(Symbol),
    Unary(Unary),
    Binary(Binary),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Unary {
    Negate,
    Not,
    Abs,
    Exp,
    Ln,
    Sqrt,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Binary {
    Or,
    And,
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
}

impl Expression {
    /// Reads an expression; `resolve` says what a name stands for.
    ///
    /// # Errors
    /// Where reading stopped and why, in words.
    pub fn parse(
        text: &str,
        resolve: &dyn Fn(&str) -> Option<Symbol>,
    ) -> Result<Expression, ExpressionError> {
        parser::parse(text, resolve).map(|operations| Expression { text: text.to_owned(), operations })
    }

    /// As the profile wrote it.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its value, with `value` giving each signal and `time` the time since machine start in seconds. NaN where any part of it
    /// is not a number.
    ///
    /// # Errors
    /// The first signal without a value, or a machine that has not been seen running.
    pub fn evaluate(
        &self,
        value: &dyn Fn(SignalId) -> Option<f64>,
        time: Option<f64>,
    ) -> Result<f64, Unusable> {
        let mut stack = [0.0f64; DEPTH];
        let mut top = 0usize;
        for operation in &self.operations {
            match operation {
                Operation::Push(symbol) => {
                    stack[top] = match symbol {
                        Symbol::Signal(id) => value(*id).ok_or(Unusable::Signal(*id))?,
                        Symbol::Constant(number) => *number,
                        Symbol::Time => time.ok_or(Unusable::MachineOff)?,
                    };
                    top += 1;
                }
                Operation::Unary(operator) => stack[top - 1] = operator.apply(stack[top - 1]),
                Operation::Binary(operator) => {
                    top -= 1;
                    stack[top - 1] = operator.apply(stack[top - 1], stack[top]);
                }
            }
            // `max(0/0, 3)` and `0/0 > 1` would hide it.
            if stack[top - 1].is_nan() {
                return Ok(f64::NAN);
            }
        }
        Ok(stack[0])
    }

    /// The signals it names, each once.
    pub fn signals(&self) -> Vec<SignalId> {
        let mut signals = Vec::new();
        for operation in &self.operations {
            if let Operation::Push(Symbol::Signal(id)) = operation
                && !signals.contains(id)
            {
                signals.push(*id);
            }
        }
        signals
    }
}

/// Truth is 1, falsehood 0.
fn truth(yes: bool) -> f64 {
    f64::from(u8::from(yes))
}

/// Anything but zero is true.
#[allow(clippy::float_cmp, reason = "truth is exact: a status register is 1 or it is not")]
fn is_true(value: f64) -> bool {
    value != 0.0
}

impl Unary {
    fn apply(self, x: f64) -> f64 {
        match self {
            Unary::Negate => -x,
            Unary::Not => truth(!is_true(x)),
            Unary::Abs => x.abs(),
            Unary::Exp => x.exp(),
            Unary::Ln => x.ln(),
            Unary::Sqrt => x.sqrt(),
        }
    }
}

impl Binary {
    #[allow(clippy::float_cmp, reason = "the user wrote ==")]
    fn apply(self, x: f64, y: f64) -> f64 {
        match self {
            Binary::Or => truth(is_true(x) || is_true(y)),
            Binary::And => truth(is_true(x) && is_true(y)),
            Binary::Equal => truth(x == y),
            Binary::NotEqual => truth(x != y),
            Binary::Less => truth(x < y),
            Binary::LessOrEqual => truth(x <= y),
            Binary::Greater => truth(x > y),
            Binary::GreaterOrEqual => truth(x >= y),
            Binary::Add => x + y,
            Binary::Subtract => x - y,
            Binary::Multiply => x * y,
            Binary::Divide => x / y,
            Binary::Power => x.powf(y),
            Binary::Min => x.min(y),
            Binary::Max => x.max(y),
        }
    }
}

/// A model written as an expression.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    /// Its value is Cz in µm.
    pub expression: Expression,
}

impl Evaluate for Formula {
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        let time = inputs.machine.on_time(inputs.snapshot.now).map(|span| span.as_secs_f64());
        Outputs::of(self.expression.evaluate(&|id| inputs.snapshot.value(id), time)?, 0.0)
    }

    fn signals(&self) -> Vec<SignalId> {
        self.expression.signals()
    }
}

/// A yes or no over signals: interlocks and fault bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// As the profile wrote it.
    pub text: String,
    expression: Expression,
}

impl Condition {
    /// Reads a condition over signals.
    ///
    /// # Errors
    /// Where reading stopped and why, in words.
    pub fn parse(
        text: &str,
        resolve: &dyn Fn(&str) -> Option<SignalId>,
    ) -> Result<Condition, ExpressionError> {
        let expression = Expression::parse(text, &|name| resolve(name).map(Symbol::Signal))?;
        Ok(Condition { text: text.to_owned(), expression })
    }

    /// Whether it holds; `None` where a signal it names has no value, or it is not a number.
    pub fn holds(&self, value: &dyn Fn(SignalId) -> Option<f64>) -> Option<bool> {
        let value = self.expression.evaluate(value, None).ok()?;
        (!value.is_nan()).then(|| is_true(value))
    }

    /// The signals it names.
    pub fn signals(&self) -> Vec<SignalId> {
        self.expression.signals()
    }
}
