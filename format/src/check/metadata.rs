//! Metadata: checks the JSON in section META (spec section 2.3, rule M001).

use std::collections::HashSet;

/// Largest depth of nested arrays and objects. The outermost object has depth 1.
const MAX_DEPTH: usize = 64;

/// A fault: offset in bytes from the start of the metadata, description.
pub(crate) type Fault = (usize, String);

/// Metadata that keeps M001.
pub(crate) struct Parsed<'a> {
    /// The whole text.
    pub(crate) text: &'a str,
    /// Names of the members of the outermost object, with their offsets in bytes.
    pub(crate) names: Vec<(usize, String)>,
}

/// Checks that `bytes` are one JSON object as the specification requires. Linear time, no recursion.
///
/// # Errors
/// The first fault.
pub(crate) fn parse(bytes: &[u8]) -> Result<Parsed<'_>, Fault> {
    let text = std::str::from_utf8(bytes).map_err(|e| (e.valid_up_to(), "it is not UTF-8".to_owned()))?;
    let mut json = Json { text, at: 0 };
    if text.starts_with('\u{feff}') {
        return json.fail("it starts with a byte order mark");
    }
    json.space();
    if json.peek() != Some(b'{') {
        return json.fail("expected an object: {");
    }
    let names = json.values()?;
    if json.at != text.len() {
        return json.fail("there is text after the object");
    }
    Ok(Parsed { text, names })
}

/// A JSON text, and the offset up to which it has been read.
struct Json<'a> {
    text: &'a str,
    at: usize,
}

impl Json<'_> {
    fn fail<T>(&self, what: &str) -> Result<T, Fault> {
        Err((self.at, what.to_owned()))
    }

    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    /// Reads the next byte if it is `byte`.
    fn take(&mut self, byte: u8) -> bool {
        let there = self.peek() == Some(byte);
        self.at += usize::from(there);
        there
    }

    fn space(&mut self) {
        while let Some(b' ' | b'\t' | b'\n' | b'\r') = self.peek() {
            self.at += 1;
        }
    }

    /// Reads one value, including nested values and the space after it. Returns the names of the members of the outermost
    /// object, if it is one.
    fn values(&mut self) -> Result<Vec<(usize, String)>, Fault> {
        // The open arrays and objects; for objects, the names so far.
        let mut open: Vec<Option<HashSet<String>>> = Vec::new();
        let mut outermost = Vec::new();
        let mut text = String::new();
        loop {
            let mut ended = true;
            match self.peek() {
                Some(bracket @ (b'{' | b'[')) => {
                    if open.len() == MAX_DEPTH {
                        return self.fail("arrays and objects are nested more than 64 deep");
                    }
                    self.at += 1;
                    self.space();
                    let is_object = bracket == b'{';
                    if !self.take(if is_object { b'}' } else { b']' }) {
                        let mut names = is_object.then(HashSet::new);
                        if let Some(names) = &mut names {
                            self.name(names, open.is_empty().then_some(&mut outermost))?;
                        }
                        open.push(names);
                        ended = false;
                    }
                }
                Some(b'"') => self.string(&mut text)?,
                Some(b'-' | b'0'..=b'9') => self.number()?,
                _ => self.literal()?,
            }
            while ended {
                self.space();
                let depth = open.len();
                let Some(names) = open.last_mut() else { return Ok(outermost) };
                if self.take(b',') {
                    self.space();
                    if let Some(names) = names {
                        self.name(names, (depth == 1).then_some(&mut outermost))?;
                    }
                    ended = false;
                } else if self.take(if names.is_some() { b'}' } else { b']' }) {
                    open.pop();
                } else {
                    return self.fail("expected a comma or the end of an array or object");
                }
            }
        }
    }

    /// Reads a name, the colon and the space around it. `outermost` is there for members of the outermost object.
    fn name(&mut self, names: &mut HashSet<String>, outermost: Option<&mut Vec<(usize, String)>>) -> Result<(), Fault> {
        let at = self.at;
        let mut name = String::new();
        self.string(&mut name)?;
        self.space();
        if !self.take(b':') {
            return self.fail("expected a colon");
        }
        self.space();
        if names.contains(&name) {
            return Err((at, format!("the name {name:?} occurs twice in one object")));
        }
        if let Some(outermost) = outermost {
            outermost.push((at, name.clone()));
        }
        names.insert(name);
        Ok(())
    }

    /// Reads a string into `out`, with escapes replaced.
    fn string(&mut self, out: &mut String) -> Result<(), Fault> {
        out.clear();
        if !self.take(b'"') {
            return self.fail("expected a string");
        }
        loop {
            let plain =
                self.text.as_bytes()[self.at..].iter().take_while(|b| **b >= b' ' && !b"\"\\".contains(b)).count();
            out.push_str(&self.text[self.at..self.at + plain]);
            self.at += plain;
            match self.peek() {
                Some(b'"') => {
                    self.at += 1;
                    return Ok(());
                }
                Some(b'\\') => out.push(self.escape()?),
                Some(_) => return self.fail("a string contains a control character"),
                None => return self.fail("a string has no end"),
            }
        }
    }

    /// Reads an escape that starts at the current offset.
    fn escape(&mut self) -> Result<char, Fault> {
        let start = self.at;
        let kind = self.text.as_bytes().get(start + 1).copied();
        self.at = start + 2;
        Ok(match kind {
            Some(b'"') => '"',
            Some(b'\\') => '\\',
            Some(b'/') => '/',
            Some(b'b') => '\u{8}',
            Some(b'f') => '\u{c}',
            Some(b'n') => '\n',
            Some(b'r') => '\r',
            Some(b't') => '\t',
            Some(b'u') => {
                self.at = start;
                let first = self.unit()?;
                let low = if (0xd800..0xdc00).contains(&first) { self.unit().unwrap_or(0) } else { 0 };
                let code = match low {
                    0xdc00..0xe000 => 0x10000 + ((first - 0xd800) << 10) + (low - 0xdc00),
                    _ => first,
                };
                char::from_u32(code).ok_or((start, "a string contains half of a surrogate pair".to_owned()))?
            }
            _ => return Err((start, "a string contains an unknown escape".into())),
        })
    }

    /// Reads `\u` and four hexadecimal digits.
    fn unit(&mut self) -> Result<u32, Fault> {
        let digits = self.text.as_bytes().get(self.at..self.at + 6).filter(|bytes| bytes.starts_with(b"\\u"));
        let value = digits.and_then(|bytes| {
            bytes[2..].iter().try_fold(0, |value, digit| Some(value << 4 | char::from(*digit).to_digit(16)?))
        });
        let Some(value) = value else { return self.fail("expected \\u and four hexadecimal digits") };
        self.at += 6;
        Ok(value)
    }

    fn number(&mut self) -> Result<(), Fault> {
        let start = self.at;
        self.take(b'-');
        if !self.take(b'0') {
            self.digits()?;
        }
        if self.take(b'.') {
            self.digits()?;
        }
        if self.take(b'e') || self.take(b'E') {
            let _ = self.take(b'+') || self.take(b'-');
            self.digits()?;
        }
        // Rounds to nearest, ties to even.
        match self.text[start..self.at].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(()),
            _ => Err((start, "a number is out of the range of binary64".into())),
        }
    }

    /// Reads at least one digit.
    fn digits(&mut self) -> Result<(), Fault> {
        let start = self.at;
        while let Some(b'0'..=b'9') = self.peek() {
            self.at += 1;
        }
        if self.at == start { self.fail("expected a digit") } else { Ok(()) }
    }

    fn literal(&mut self) -> Result<(), Fault> {
        for word in ["true", "false", "null"] {
            if self.text[self.at..].starts_with(word) {
                self.at += word.len();
                return Ok(());
            }
        }
        self.fail("expected a value")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether serde_json accepts the text. It must agree except where the specification is stricter.
    fn by_serde(text: &str) -> bool {
        serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(text).is_ok()
    }

    #[test]
    fn text_is_taken_as_json_has_it() {
        let taken = [
            "{}",
            " \t\r\n{ } \n",
            r#"{"a":[]}"#,
            r#"{"a":{}, "b" : [ 1 , -2.5e+3 ,0, -0, 1E2,true,false,null,"x"]}"#,
            r#"{"":"\"\\\/\b\f\n\r\t\u0041\ud834\udd1e\uFFFF"}"#,
            r#"{"a":{"a":[{"a":1},{"a":2}]}}"#,
            "{\"é\":\"\u{7f}\u{10ffff}\"}",
        ];
        for text in taken {
            assert!(by_serde(text), "{text}");
            let parsed = parse(text.as_bytes()).map_err(|fault| format!("{text}: {fault:?}")).unwrap();
            assert_eq!(parsed.text, text);
        }
        let refused = [
            "",
            " ",
            "[]",
            "null",
            "{",
            "}",
            "{}x",
            "{}{}",
            "{},",
            "{}\0",
            "{a:1}",
            "{'a':1}",
            r#"{"a"}"#,
            r#"{"a":}"#,
            r#"{"a":1,}"#,
            r#"{,"a":1}"#,
            r#"{"a":1 "b":2}"#,
            r#"{"a":[1,]}"#,
            r#"{"a":[1 2]}"#,
            r#"{"a":[1}"#,
            r#"{"a":{]}"#,
            r#"{"a":01}"#,
            r#"{"a":+1}"#,
            r#"{"a":.5}"#,
            r#"{"a":1.}"#,
            r#"{"a":1e}"#,
            r#"{"a":-}"#,
            r#"{"a":NaN}"#,
            r#"{"a":Infinity}"#,
            r#"{"a":True}"#,
            r#"{"a":nul}"#,
            r#"{"a":"}"#,
            r#"{"a":"\x"}"#,
            r#"{"a":"\u12"}"#,
            r#"{"a":"\u12g4"}"#,
            r#"{"a":"\"#,
            "{\"a\":\"\n\"}",
            "{\"a\":\"\t\"}",
            "{\"a\":\"\0\"}",
            r#"{"a":"\ud800"}"#,
            r#"{"a":"\ud800x"}"#,
            r#"{"a":"\ud800\n"}"#,
            r#"{"a":"\ud800\u0041"}"#,
            r#"{"a":"\udc00"}"#,
            r#"{"a":"\udc00\ud800"}"#,
            r#"{"\ud800":1}"#,
            "{\"a\":1/**/}",
            "\u{feff}{}",
            "{\u{a0}}",
            r#"{"a":1e999}"#,
            r#"{"a":"\u+123"}"#,
        ];
        for text in refused {
            assert!(!by_serde(text), "{text}");
            assert!(parse(text.as_bytes()).is_err(), "{text}");
        }
    }

    #[test]
    fn the_specification_is_stricter_than_json() {
        let nested = |depth: usize| format!(r#"{{"a":{}{}}}"#, "[".repeat(depth - 1), "]".repeat(depth - 1));
        assert!(parse(nested(64).as_bytes()).is_ok() && by_serde(&nested(64)));
        assert!(parse(nested(65).as_bytes()).is_err() && by_serde(&nested(65)));
        assert!(parse(nested(1_000_000).as_bytes()).is_err(), "without recursion");
        for text in [r#"{"a":1,"a":1}"#, r#"{"a":1,"\u0061":2}"#, r#"{"x":{"a":1,"b":[{"a":1}],"a":2}}"#] {
            assert!(by_serde(text) && parse(text.as_bytes()).is_err(), "{text}");
        }
        // The greatest number that rounds to a finite one, the least that does not, and one that rounds to zero.
        for (number, fits) in [
            ("1.797693134862315807e308", true),
            ("1.7976931348623159e308", false),
            ("-1.7976931348623159e308", false),
            ("1e-999", true),
        ] {
            assert_eq!(parse(format!(r#"{{"a":{number}}}"#).as_bytes()).is_ok(), fits, "{number}");
        }
        let digits = |count| format!(r#"{{"a":{}}}"#, "9".repeat(count));
        assert!(parse(digits(308).as_bytes()).is_ok() && parse(digits(309).as_bytes()).is_err());
        // Overlong, a surrogate, cut short, above U+10FFFF.
        for bytes in [&b"\xc0\x80"[..], b"\xed\xa0\x80", b"\xe2\x82", b"\xf4\x90\x80\x80", b"\xff"] {
            for text in [[b"{\"a\":\"", bytes, b"\"}"].concat(), [b"{\"", bytes, b"\":1}"].concat()] {
                assert!(parse(&text).is_err(), "{text:x?}");
            }
        }
    }

    #[test]
    fn names_of_the_outermost_object_are_found() {
        let text = br#"{"title":1,"x":{"author":2},"\u006cicense":"MIT","created":null}"#;
        let found = parse(text).ok().unwrap().names;
        let named = |at, name: &str| (at, name.to_owned());
        assert_eq!(found, [named(1, "title"), named(11, "x"), named(28, "license"), named(49, "created")]);
    }

    #[test]
    fn faults_have_places() {
        let at = |text: &str| parse(text.as_bytes()).err().unwrap();
        assert_eq!(at(r#"{"a":1,"b":2,"a":3}"#), (13, "the name \"a\" occurs twice in one object".into()));
        assert_eq!(at(r#"{"a":"xy\ud800z"}"#).0, 8);
        assert_eq!(at(r#"{"a":[1,1e999]}"#).0, 8);
        assert_eq!(at("").0, 0);
    }
}
