//! Pieces of JSON.

use std::fmt::Write as _;

/// A text, with a comma where something stands in it.
pub(crate) fn comma(text: &mut String) -> &mut String {
    if !text.is_empty() {
        text.push(',');
    }
    text
}

/// A text, with a member's name behind what stands in it.
pub(crate) fn key<'a>(text: &'a mut String, name: &str) -> &'a mut String {
    string(comma(text), name);
    text.push(':');
    text
}

/// A text, with numbers behind what stands in it.
pub(crate) fn whole(text: &mut String, numbers: &[u32]) {
    for number in numbers {
        let _ = write!(comma(text), "{number}");
    }
}

pub(crate) fn string(text: &mut String, value: &str) {
    text.push('"');
    for c in value.chars() {
        match c {
            '"' | '\\' | '\0'..='\x1f' => {
                let _ = write!(text, "\\u{:04x}", c as u32);
            }
            _ => text.push(c),
        }
    }
    text.push('"');
}
