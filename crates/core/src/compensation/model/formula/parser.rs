//! Parser of expressions, by precedence climbing over a list of tokens. Its result is a list of operations for a stack
//! machine.

use super::{Binary, DEPTH, Operation, Symbol, Unary};

/// Reason why an expression cannot be parsed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpressionError {
    /// Byte position of the mistake in the text.
    pub at: usize,
    /// Message about the mistake, without its position.
    pub message: String,
}

#[derive(Clone, Debug, PartialEq)]
enum Token<'a> {
    Number(f64),
    Name(&'a str),
    Sign(&'a str),
}

struct Parser<'a> {
    tokens: Vec<(usize, Token<'a>)>,
    next: usize,
    end: usize,
    nesting: usize,
    resolve: &'a dyn Fn(&str) -> Option<Symbol>,
    operations: Vec<Operation>,
}

const SIGNS: [&str; 17] =
    ["==", "!=", "<=", ">=", "&&", "||", "<", ">", "+", "-", "*", "/", "^", "(", ")", ",", "!"];

pub(super) fn parse(
    text: &str,
    resolve: &dyn Fn(&str) -> Option<Symbol>,
) -> Result<Vec<Operation>, ExpressionError> {
    let tokens = tokens(text)?;
    let mut parser = Parser { tokens, next: 0, end: text.len(), nesting: 0, resolve, operations: Vec::new() };
    parser.binary(0)?;
    if parser.next < parser.tokens.len() {
        return Err(parser.error("an operator was expected here"));
    }
    if deepest(&parser.operations) > DEPTH {
        return Err(ExpressionError {
            at: 0,
            message: format!("the expression is nested deeper than {DEPTH} levels"),
        });
    }
    Ok(parser.operations)
}

fn tokens(text: &str) -> Result<Vec<(usize, Token<'_>)>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let length = if first.is_whitespace() {
            first.len_utf8()
        } else if first.is_ascii_digit() || first == '.' {
            let length = number_length(rest);
            let number = rest[..length].parse().map_err(|_| ExpressionError {
                at,
                message: format!("`{}` is not a number", &rest[..length]),
            })?;
            tokens.push((at, Token::Number(number)));
            length
        } else if first.is_alphabetic() || first == '_' {
            let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
            tokens.push((at, Token::Name(&rest[..length])));
            length
        } else if let Some(sign) = SIGNS.iter().find(|sign| rest.starts_with(**sign)) {
            tokens.push((at, Token::Sign(sign)));
            sign.len()
        } else {
            let hint = if first == '=' { "; write == to compare" } else { "" };
            return Err(ExpressionError {
                at,
                message: format!("`{first}` is not allowed in an expression{hint}"),
            });
        };
        at += length;
    }
    Ok(tokens)
}

/// Returns the length in bytes of the number at the beginning of the text: digits, a point, and an exponent with its
/// own sign.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut length = 0;
    while let Some(byte) = bytes.get(length) {
        let signed_exponent =
            matches!(byte, b'+' | b'-') && length > 0 && matches!(bytes[length - 1], b'e' | b'E');
        if !(byte.is_ascii_digit() || matches!(byte, b'.' | b'e' | b'E') || signed_exponent) {
            break;
        }
        length += 1;
    }
    length
}

/// Returns the maximum number of values on the stack during these operations.
fn deepest(operations: &[Operation]) -> usize {
    let mut height = 0usize;
    let mut most = 0usize;
    for operation in operations {
        match operation {
            Operation::Push(_) => height += 1,
            Operation::Unary(_) => {}
            Operation::Binary(_) => height -= 1,
        }
        most = most.max(height);
    }
    most
}

impl<'a> Parser<'a> {
    fn error(&self, message: &str) -> ExpressionError {
        let at = self.tokens.get(self.next).map_or(self.end, |(at, _)| *at);
        ExpressionError { at, message: message.to_owned() }
    }

    fn peek(&self) -> Option<&Token<'a>> {
        self.tokens.get(self.next).map(|(_, token)| token)
    }

    fn take(&mut self, sign: &str) -> bool {
        let found = self.peek() == Some(&Token::Sign(sign));
        self.next += usize::from(found);
        found
    }

    fn expect(&mut self, sign: &str) -> Result<(), ExpressionError> {
        if self.take(sign) { Ok(()) } else { Err(self.error(&format!("`{sign}` was expected here"))) }
    }

    /// Parses an operand, and all operators after it that bind at least as tightly as `weakest`. Operators of equal
    /// strength associate to the left.
    fn binary(&mut self, weakest: u8) -> Result<(), ExpressionError> {
        self.unary()?;
        while let Some((operator, strength)) = self.peek().and_then(binary_operator) {
            if strength < weakest {
                break;
            }
            self.next += 1;
            self.binary(strength + 1)?;
            self.operations.push(Operation::Binary(operator));
        }
        Ok(())
    }

    /// Parses an operand with its sign or `not`. The depth of nesting is counted in this function, because every kind
    /// of nesting calls it.
    fn unary(&mut self) -> Result<(), ExpressionError> {
        self.nesting += 1;
        if self.nesting > 4 * DEPTH {
            return Err(self.error("the expression is nested too deeply"));
        }
        // `not a == b` negates the comparison; `-a * b` negates only a.
        let (operator, weakest) = match self.peek() {
            Some(Token::Sign("-")) => (Some(Unary::Negate), FACTOR + 1),
            Some(Token::Sign("!") | Token::Name("not")) => (Some(Unary::Not), COMPARISON),
            _ => (None, 0),
        };
        if let Some(operator) = operator {
            self.next += 1;
            self.binary(weakest)?;
            self.operations.push(Operation::Unary(operator));
        } else {
            self.power()?;
        }
        self.nesting -= 1;
        Ok(())
    }

    /// Parses `a ^ b`, which associates to the right, and binds tighter than a minus sign before `a`.
    fn power(&mut self) -> Result<(), ExpressionError> {
        self.atom()?;
        if self.take("^") {
            self.unary()?;
            self.operations.push(Operation::Binary(Binary::Power));
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<(), ExpressionError> {
        let Some((at, token)) = self.tokens.get(self.next).cloned() else {
            return Err(self.error("the expression ends where a value was expected"));
        };
        self.next += 1;
        match token {
            Token::Number(number) => self.operations.push(Operation::Push(Symbol::Constant(number))),
            Token::Name(name) if self.peek() == Some(&Token::Sign("(")) => self.call(at, name)?,
            Token::Name(name) => {
                let symbol = (self.resolve)(name).ok_or_else(|| ExpressionError {
                    at,
                    message: format!("`{name}` is not known in this expression"),
                })?;
                self.operations.push(Operation::Push(symbol));
            }
            Token::Sign("(") => {
                self.binary(0)?;
                self.expect(")")?;
            }
            Token::Sign(sign) => {
                return Err(ExpressionError { at, message: format!("a value was expected, not `{sign}`") });
            }
        }
        Ok(())
    }

    fn call(&mut self, at: usize, name: &str) -> Result<(), ExpressionError> {
        self.expect("(")?;
        self.binary(0)?;
        let operation = match name {
            "abs" => Operation::Unary(Unary::Abs),
            "exp" => Operation::Unary(Unary::Exp),
            "ln" => Operation::Unary(Unary::Ln),
            "sqrt" => Operation::Unary(Unary::Sqrt),
            "min" | "max" => {
                self.expect(",")?;
                self.binary(0)?;
                Operation::Binary(if name == "min" { Binary::Min } else { Binary::Max })
            }
            _ => {
                let message = format!("`{name}` is not a function; allowed: abs, exp, ln, sqrt, min, max");
                return Err(ExpressionError { at, message });
            }
        };
        self.expect(")")?;
        self.operations.push(operation);
        Ok(())
    }
}

const COMPARISON: u8 = 3;
const FACTOR: u8 = 5;

fn binary_operator(token: &Token<'_>) -> Option<(Binary, u8)> {
    Some(match token {
        Token::Name("or") | Token::Sign("||") => (Binary::Or, 1),
        Token::Name("and") | Token::Sign("&&") => (Binary::And, 2),
        Token::Sign("==") => (Binary::Equal, COMPARISON),
        Token::Sign("!=") => (Binary::NotEqual, COMPARISON),
        Token::Sign("<") => (Binary::Less, COMPARISON),
        Token::Sign("<=") => (Binary::LessOrEqual, COMPARISON),
        Token::Sign(">") => (Binary::Greater, COMPARISON),
        Token::Sign(">=") => (Binary::GreaterOrEqual, COMPARISON),
        Token::Sign("+") => (Binary::Add, 4),
        Token::Sign("-") => (Binary::Subtract, 4),
        Token::Sign("*") => (Binary::Multiply, FACTOR),
        Token::Sign("/") => (Binary::Divide, FACTOR),
        _ => return None,
    })
}
