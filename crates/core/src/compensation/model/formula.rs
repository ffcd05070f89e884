//! Expressions of a profile, such as `Kz * (A - (b*t + c))` for a model or `cnc_on == 1` for a condition.
//!
//! An expression is parsed once into a list of operations on a small stack. Evaluation allocates no memory. Operators,
//! weakest first: `or`, `and`, `not`, `== != < <= > >=`, `+ -`, `* /`, unary `-`, `^`. Functions:
//! `abs exp ln sqrt min max`. The reference case is the model M2 of JP H07-61598 B2.

use super::{Evaluate, Inputs, Outputs, Unusable};
use crate::reading::SignalId;

mod parser;
#[cfg(test)]
mod tests;

pub use parser::ExpressionError;

/// Maximum nesting of an expression, which is also the size of the stack that evaluates it.
const DEPTH: usize = 32;

/// Parsed expression over signals and the time since machine start.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    text: String,
    operations: Vec<Operation>,
}

/// Meaning of a name in an expression: a signal, a constant, or the time since machine start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Symbol {
    /// The value of a signal.
    Signal(SignalId),
    /// Number: a constant of the model, or a number in the text of the expression.
    Constant(f64),
    /// Time since machine start in seconds.
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
    /// Parses an expression. `resolve` returns the meaning of a name; `None` if the name is unknown.
    ///
    /// # Errors
    /// Returns the byte position of the mistake in the text, and a message.
    pub fn parse(
        text: &str,
        resolve: &dyn Fn(&str) -> Option<Symbol>,
    ) -> Result<Expression, ExpressionError> {
        parser::parse(text, resolve).map(|operations| Expression { text: text.to_owned(), operations })
    }

    /// Returns the text of the expression, as the profile contains it.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Evaluates the expression. `value` returns the value of a signal, and `time` is the time since machine start in
    /// seconds. The result is NaN if a part of the expression is NaN.
    ///
    /// # Errors
    /// Returns the first signal without a value, or that the gateway has not seen the machine running.
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
            // Operations as `max(0/0, 3)` and `0/0 > 1` would hide a NaN.
            if stack[top - 1].is_nan() {
                return Ok(f64::NAN);
            }
        }
        Ok(stack[0])
    }

    /// Returns the signals of the expression, without duplicates.
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

/// Returns a truth value as a number: 1 for true, 0 for false.
fn truth(yes: bool) -> f64 {
    f64::from(u8::from(yes))
}

/// Returns whether a number counts as true: any number except zero does.
#[allow(clippy::float_cmp, reason = "only zero is false, so the comparison must be exact")]
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

/// Model whose Cz is an expression of the profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    /// Expression that gives Cz in µm.
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

/// Condition over signals, for interlocks and fault bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// Text of the condition, as the profile contains it.
    pub text: String,
    expression: Expression,
}

impl Condition {
    /// Parses a condition over signals. `resolve` returns the signal of a name; `None` if no signal has this name.
    ///
    /// # Errors
    /// Returns the byte position of the mistake in the text, and a message.
    pub fn parse(
        text: &str,
        resolve: &dyn Fn(&str) -> Option<SignalId>,
    ) -> Result<Condition, ExpressionError> {
        let expression = Expression::parse(text, &|name| resolve(name).map(Symbol::Signal))?;
        Ok(Condition { text: text.to_owned(), expression })
    }

    /// Returns whether the condition is true; `None` if a signal in it has no value, or if the result is NaN.
    pub fn holds(&self, value: &dyn Fn(SignalId) -> Option<f64>) -> Option<bool> {
        let value = self.expression.evaluate(value, None).ok()?;
        (!value.is_nan()).then(|| is_true(value))
    }

    /// Returns the signals of the condition, without duplicates.
    pub fn signals(&self) -> Vec<SignalId> {
        self.expression.signals()
    }
}
