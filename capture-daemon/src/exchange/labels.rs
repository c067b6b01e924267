//! What an artist calls the elements of a drawing, where their ids do not say it.
//!
//! An element is called, in this order: by an id that somebody gave it, by its `inkscape:label`, by the text of its
//! `<title>`, by an id that a drawing program made up (`path846`, `g12-3`).

use std::collections::HashMap;

use usvg::roxmltree::{Document, Node};

/// The namespace of `inkscape:label`.
const INKSCAPE: &str = "http://www.inkscape.org/namespaces/inkscape";
/// What ids begin with that drawing programs make up; digits follow.
const MADE_UP: [&str; 10] =
    ["path", "rect", "circle", "ellipse", "polygon", "polyline", "g", "use", "layer", "svg"];

/// Labels and titles of a drawing, by the ids of what they are of.
#[derive(Debug, Default)]
pub(super) struct Labels(HashMap<String, String>);

impl Labels {
    /// Those of elements that have an id. O(elements).
    pub(super) fn of(drawing: &Document<'_>) -> Self {
        let labelled = drawing.descendants().filter_map(|node| Some((node.attribute("id")?, label(node)?)));
        Self(labelled.map(|(id, label)| (id.to_owned(), label)).collect())
    }

    /// What the element with this id is called; the id itself, where nothing says it better.
    pub(super) fn name<'a>(&'a self, id: &'a str) -> &'a str {
        let label = || self.0.get(id).map(String::as_str);
        if is_made_up(id) { label().unwrap_or(id) } else { id }
    }
}

/// The label of an element, else its title.
fn label(node: Node<'_, '_>) -> Option<String> {
    let title = || node.children().find(|child| child.tag_name().name() == "title")?.text();
    let text = node.attribute((INKSCAPE, "label")).or_else(title)?.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

/// Whether nobody gave this id: as drawing programs number what is drawn, and as
/// [`super::svg_export`] numbers outlines.
fn is_made_up(id: &str) -> bool {
    let numbered = |rest: &str| {
        rest.starts_with(|c: char| c.is_ascii_digit())
            && rest.chars().all(|c| c.is_ascii_digit() || matches!(c, '-' | '_' | '.'))
    };
    id.starts_with("outline-") || MADE_UP.iter().any(|kind| id.strip_prefix(kind).is_some_and(numbered))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_that_were_given_come_first_then_labels_titles_and_ids_that_were_made_up() {
        let text = "<svg xmlns='http://www.w3.org/2000/svg' xmlns:inkscape='http://www.inkscape.org/namespaces/inkscape'>\
            <path id='fern' inkscape:label='moss'/><path id='path846-3' inkscape:label=' moss '><title>reed</title></path>\
            <g id='g12'><title>reed</title></g><path id='path7' inkscape:label=''/><path id='pathway'><title>x</title></path>\
            <path inkscape:label='no id'/></svg>";
        let labels = Labels::of(&Document::parse(text).expect("XML"));
        for (id, name) in [
            ("fern", "fern"),
            ("path846-3", "moss"),
            ("g12", "reed"),
            ("path7", "path7"),
            ("pathway", "pathway"),
        ] {
            assert_eq!(labels.name(id), name);
        }
        assert!(is_made_up("outline-4") && !is_made_up("g") && !is_made_up("gras7") && !is_made_up("path2d"));
    }
}
