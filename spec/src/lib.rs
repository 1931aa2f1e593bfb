//! The esvo file format specification, version 1, as data: its numbered rules for programs that cite them.
//!
//! The prose is in `spec/v1/README.md`. Nothing here parses anything.

mod rules;

pub use rules::{Level, RULES, Rule, ids};

/// The prose of version 1 of the specification.
pub const TEXT_V1: &str = include_str!("../v1/README.md");

/// The rule with this id, if there is one.
pub fn rule(id: &str) -> Option<&'static Rule> {
    RULES.iter().find(|rule| rule.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rule is cited where it belongs and listed in the appendix, word for word.
    #[test]
    fn every_rule_stands_in_the_text_and_every_id_of_the_text_is_a_rule() {
        let (body, appendix) = TEXT_V1.split_once("## Appendix C").expect("the list of rules");
        for rule in RULES {
            assert!(body.contains(&format!("**{}**", rule.id)), "{} is not in the text", rule.id);
            let level = match rule.level {
                Level::Must => "must",
                Level::Should => "should",
            };
            let line = format!("| **{}** | {level} | {} |\n", rule.id, rule.text);
            assert!(appendix.contains(&line), "the list lacks or differs in: {line}");
        }
        let listed = appendix.lines().filter(|line| line.starts_with("| **")).count();
        assert_eq!(listed, RULES.len());
        let cited = TEXT_V1.split("**").filter(|part| is_id(part));
        for id in cited {
            assert!(rule(id).is_some(), "the text has {id}, the rules do not");
        }
    }

    #[test]
    fn ids_are_unique_and_well_formed() {
        for (i, rule) in RULES.iter().enumerate() {
            assert!(is_id(rule.id), "{}", rule.id);
            assert!(RULES[..i].iter().all(|other| other.id != rule.id), "{} stands twice", rule.id);
        }
    }

    fn is_id(s: &str) -> bool {
        s.len() == 4 && s.starts_with(|c: char| c.is_ascii_uppercase()) && s[1..].bytes().all(|b| b.is_ascii_digit())
    }
}
