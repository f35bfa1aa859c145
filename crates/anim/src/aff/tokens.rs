//! The words of an AFF file: separated by white space, with braces on their own and comments left
//! out.

use std::str::{Split, SplitAsciiWhitespace};

use glam::DVec3;

use crate::error::Problem;

/// A text with its braces between spaces, for [`Tokens`], and without vertical tabs.
pub(super) fn spaced(text: &[u8]) -> String {
    String::from_utf8_lossy(text).replace('{', " { ").replace('}', " } ").replace('\x0b', " ")
}

/// What is left of a file. Cloning it is looking ahead.
#[derive(Clone)]
pub(super) struct Tokens<'a> {
    lines: Split<'a, char>,
    /// What is left of the line, which is number `line`, counted from 1.
    words: SplitAsciiWhitespace<'a>,
    line: usize,
}

impl<'a> Tokens<'a> {
    /// The words of a text that is [`spaced`].
    pub(super) fn new(text: &'a str) -> Self {
        Self { lines: text.split('\n'), words: "".split_ascii_whitespace(), line: 0 }
    }

    /// The next word, `{` or `}`; comments run from a word that starts with `#` or `%` to the end
    /// of the line.
    pub(super) fn next(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.words.next().filter(|word| !word.starts_with(['#', '%'])) {
                return Some(word);
            }
            // At the end, too, nothing is left of a comment.
            self.words = "".split_ascii_whitespace();
            self.words = self.lines.next()?.split_ascii_whitespace();
            self.line += 1;
        }
    }

    pub(super) fn peek(&self) -> Option<&'a str> {
        self.clone().next()
    }

    /// That `found` stands where the last token was read, and not what was `expected`.
    pub(super) fn problem(&self, found: Option<&str>, expected: impl Into<String>) -> Problem {
        let found = found.map_or_else(|| "the end of the file".to_owned(), |word| format!("{word:?}"));
        self.because(found, expected)
    }

    /// That what was read last is wrong in a way its words do not show.
    pub(super) fn because(&self, found: impl std::fmt::Display, expected: impl Into<String>) -> Problem {
        Problem::new(format!("line {}", self.line), found, expected)
    }

    /// A word, such as a name.
    pub(super) fn word(&mut self, expected: &str) -> Result<&'a str, Problem> {
        match self.next() {
            Some(word) if !matches!(word, "{" | "}") => Ok(word),
            found => Err(self.problem(found, expected)),
        }
    }

    /// One particular word.
    pub(super) fn expect(&mut self, word: &str) -> Result<(), Problem> {
        match self.next() {
            Some(found) if found == word => Ok(()),
            found => Err(self.problem(found, format!("{word:?}"))),
        }
    }

    /// A finite number.
    pub(super) fn number(&mut self) -> Result<f64, Problem> {
        let token = self.next();
        let number = token.and_then(|token| token.parse().ok()).filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.problem(token, "a finite number"))
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
        let count = token.and_then(|token| token.parse::<u32>().ok());
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
