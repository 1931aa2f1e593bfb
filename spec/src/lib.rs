#![doc = include_str!("../README.md")]

mod rules;

pub use rules::{Level, RULES, Rule, ids};

/// The text of version 1 of the specification, in Markdown.
pub const TEXT_V1: &str = include_str!("../v1/README.md");

/// The layout of version 1 as a Kaitai Struct description.
pub const KSY_V1: &str = include_str!("../v1/esvo.ksy");

/// The registered metadata of version 1 as a JSON schema, draft 2020-12 (section 2.3 of the text).
pub const METADATA_SCHEMA_V1: &str = include_str!("../v1/metadata.schema.json");

/// The folder with the test vectors of version 1, on the machine that compiled this crate: `valid`, `invalid` and
/// `streaming`, described in its `README.md`.
pub const VECTORS_V1: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/v1/vectors");

/// The rule with this id, if there is one.
pub fn rule(id: &str) -> Option<&'static Rule> {
    RULES.iter().find(|rule| rule.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text before and after the heading of the list of rules.
    fn parts() -> (&'static str, &'static str) {
        TEXT_V1.split_once("## Appendix C: rules").expect("the list of rules")
    }

    #[test]
    fn the_list_in_the_text_is_that_of_the_rules() {
        let rows = RULES.iter().map(|rule| {
            let level = match rule.level {
                Level::Must => "must",
                Level::Should => "should",
            };
            format!("| **{}** | {level} | {} |", rule.id, rule.text)
        });
        let listed = parts().1.lines().filter(|line| line.starts_with("| **"));
        assert_eq!(listed.collect::<Vec<_>>(), rows.collect::<Vec<_>>());
    }

    #[test]
    fn every_rule_is_cited_and_every_id_that_is_cited_is_a_rule() {
        for rule in RULES {
            assert!(parts().0.contains(&format!("**{}**", rule.id)), "{} is not in the text", rule.id);
        }
        for id in words(TEXT_V1) {
            assert!(rule(id).is_some(), "the text has {id}, the rules do not");
        }
    }

    #[test]
    fn ids_are_unique_and_well_formed() {
        for (i, rule) in RULES.iter().enumerate() {
            assert!(is_id(rule.id), "{}", rule.id);
            assert!(RULES[..i].iter().all(|other| other.id != rule.id), "{} is there twice", rule.id);
            assert!(rule.text.ends_with('.'), "{}", rule.id);
        }
    }

    /// What looks like an id.
    fn words(text: &str) -> impl Iterator<Item = &str> {
        text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| is_id(word))
    }

    fn is_id(s: &str) -> bool {
        s.len() == 4
            && s.starts_with(['H', 'D', 'M', 'F', 'O', 'N', 'B', 'S', 'I', 'P', 'C', 'K', 'A'])
            && s[1..].bytes().all(|b| b.is_ascii_digit())
    }
}
