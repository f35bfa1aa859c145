//! The words of an AFF file: separated by white space, with braces on their own and comments left
//! out.

use glam::DVec3;

use crate::error::Problem;

/// What is left of a file. Copying it is looking ahead.
#[derive(Clone, Copy)]
pub(super) struct Tokens<'a> {
    rest: &'a [u8],
    line: usize,
    /// Lists of keys that were not in the order of their times.
    pub(super) disordered: usize,
}

impl<'a> Tokens<'a> {
    pub(super) fn new(text: &'a [u8]) -> Self {
        Self { rest: text, line: 1, disordered: 0 }
    }

    /// The next word, `{` or `}`; comments run from `#` or `%` to the end of the line.
    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        while let Some(&byte) = self.rest.first() {
            let until = |ends: fn(u8) -> bool| self.rest.iter().position(|&byte| ends(byte));
            let length = match byte {
                b'#' | b'%' => until(|byte| byte == b'\n'),
                _ if ends_word(byte) => Some(1),
                _ => until(ends_word),
            };
            let (token, rest) = self.rest.split_at(length.unwrap_or(self.rest.len()));
            self.rest = rest;
            self.line += usize::from(byte == b'\n');
            if !is_space(byte) && !matches!(byte, b'#' | b'%') {
                return Some(token);
            }
        }
        None
    }

    pub(super) fn peek(mut self) -> Option<&'a [u8]> {
        self.next()
    }

    /// That `found` stands where the last token was read, and not what was `expected`.
    pub(super) fn problem(&self, found: Option<&[u8]>, expected: impl Into<String>) -> Problem {
        const LONGEST: usize = 40;
        let found = match found {
            None => "the end of the file".into(),
            Some(token) => {
                let shown = String::from_utf8_lossy(&token[..token.len().min(LONGEST)]);
                format!("{shown:?}{}", if token.len() > LONGEST { "..." } else { "" })
            }
        };
        self.because(found, expected)
    }

    /// That what was read last is wrong in a way its words do not show.
    pub(super) fn because(&self, found: impl std::fmt::Display, expected: impl Into<String>) -> Problem {
        Problem::new(format!("line {}", self.line), found, expected)
    }

    /// A word, such as a name.
    pub(super) fn word(&mut self, expected: &str) -> Result<&'a [u8], Problem> {
        match self.next() {
            Some(word) if !matches!(word, b"{" | b"}") => Ok(word),
            found => Err(self.problem(found, expected)),
        }
    }

    /// One particular word.
    pub(super) fn expect(&mut self, word: &str) -> Result<(), Problem> {
        match self.next() {
            Some(found) if found == word.as_bytes() => Ok(()),
            found => Err(self.problem(found, format!("{word:?}"))),
        }
    }

    /// A finite number.
    pub(super) fn number(&mut self) -> Result<f64, Problem> {
        let token = self.next();
        token
            .and_then(number)
            .filter(|number| number.is_finite())
            .ok_or_else(|| self.problem(token, "a finite number"))
    }

    pub(super) fn next_is_number(&self) -> bool {
        self.peek().and_then(number).is_some()
    }

    pub(super) fn numbers<const N: usize>(&mut self) -> Result<[f64; N], Problem> {
        let mut numbers = [0.0; N];
        numbers.iter_mut().try_for_each(|number| self.number().map(|read| *number = read))?;
        Ok(numbers)
    }

    /// Reads past numbers that nothing here depends on.
    pub(super) fn skip_numbers(&mut self, count: usize) -> Result<(), Problem> {
        (0..count).try_for_each(|_| self.number().map(drop))
    }

    pub(super) fn vector(&mut self) -> Result<DVec3, Problem> {
        self.numbers().map(DVec3::from_array)
    }

    /// As many vectors, each followed by `after` numbers that are left out.
    pub(super) fn vectors(&mut self, count: usize, after: usize) -> Result<Vec<DVec3>, Problem> {
        // Grows as the vectors come: the count may be a lie.
        let mut vectors = Vec::new();
        for _ in 0..count {
            vectors.push(self.vector()?);
            self.skip_numbers(after)?;
        }
        Ok(vectors)
    }

    /// A whole number that counts or numbers something.
    pub(super) fn count(&mut self, expected: &str) -> Result<usize, Problem> {
        let token = self.next();
        let count = token.and_then(|token| str::from_utf8(token).ok()?.parse::<u32>().ok());
        count.map(|count| count as usize).ok_or_else(|| self.problem(token, expected))
    }

    /// A whole number, at least `fewest`, that counts `what`.
    pub(super) fn count_from(&mut self, fewest: usize, what: &str) -> Result<usize, Problem> {
        let expected = format!("a number of {what} from {fewest} up");
        match self.count(&expected)? {
            count if count < fewest => Err(self.because(count, expected)),
            count => Ok(count),
        }
    }
}

fn number(token: &[u8]) -> Option<f64> {
    str::from_utf8(token).ok()?.parse().ok()
}

fn is_space(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == 0x0b
}

fn ends_word(byte: u8) -> bool {
    is_space(byte) || matches!(byte, b'{' | b'}')
}
