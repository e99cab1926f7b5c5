//! Content and templates make a page.

use anyhow::{Context, Result};
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, Value, escape_formatter};

use crate::content::Content;

/// The page.
///
/// # Errors
/// If the template and the content do not go together.
pub fn html(content: &Content) -> Result<String> {
    render("report.html", content)
}

/// The same in short, as Markdown.
///
/// # Errors
/// If the template and the content do not go together.
pub fn markdown(content: &Content) -> Result<String> {
    render("report.md", content)
}

fn render(name: &str, content: &Content) -> Result<String> {
    let mut environment = Environment::new();
    environment.set_syntax(SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build()?);
    environment.set_undefined_behavior(minijinja::UndefinedBehavior::Strict);
    environment.set_auto_escape_callback(|name| {
        if name.ends_with(".html") { AutoEscape::Html } else { AutoEscape::None }
    });
    // Markdown takes a bar for the end of a cell, whatever stands before it.
    environment.add_filter("cell", |text: String| text.replace('|', "\\|"));
    // A long name may be broken after its underscores.
    environment.add_filter("breakable", |text: String| {
        Value::from_safe_string(escaped(&text).replace('_', "_<wbr>"))
    });
    // As always, but for the slash, so that commands in the page can be read in its source too.
    environment.set_formatter(|output, state, value| match (state.auto_escape(), value.as_str()) {
        (AutoEscape::Html, Some(text)) if !value.is_safe() => Ok(output.write_str(&escaped(text))?),
        _ => escape_formatter(output, state, value),
    });
    for (name, template) in TEMPLATES {
        environment.add_template(name, template)?;
    }
    let page = environment.get_template(name)?.render(Serde(content));
    // A template loses its last line end.
    Ok(page.with_context(|| format!("template {name}"))? + "\n")
}

/// Text as it may stand in HTML, between tags and in attributes.
fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    text.replace('"', "&quot;").replace('\'', "&#39;")
}

const TEMPLATES: [(&str, &str); 4] = [
    ("report.html", include_str!("../templates/report.html")),
    ("parts.html", include_str!("../templates/parts.html")),
    ("style.css", include_str!("../templates/style.css")),
    ("report.md", include_str!("../templates/report.md")),
];
