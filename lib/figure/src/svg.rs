//! A picture as SVG text.

use std::fmt::Write;

use crate::font;
use crate::scene::{Anchor, Color, Item, MM, Paint, Point, Rect, Scene};

/// The SVG of a picture. No element has an id, so that several can stand in one page.
pub fn render(scene: &Scene) -> String {
    let mut svg = String::new();
    let (width, height) = (number(scene.width), number(scene.height));
    let _ = writeln!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" width=\"{}mm\" height=\"{}mm\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"{}\">",
        number(scene.width / MM),
        number(scene.height / MM),
        font::FAMILIES
    );
    let _ = writeln!(svg, "<title>{}</title>", escaped(&scene.title));
    let _ = writeln!(svg, "<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>");
    scene.items.iter().for_each(|item| write_item(&mut svg, item));
    svg.push_str("</svg>\n");
    svg
}

fn write_item(svg: &mut String, item: &Item) {
    match item {
        Item::Path { lines, closed, paint } => {
            svg.push_str("<path d=\"");
            for line in lines {
                for (i, &(x, y)) in line.iter().enumerate() {
                    svg.push(if i == 0 { 'M' } else { 'L' });
                    write_point(svg, (x, y));
                }
                if *closed {
                    svg.push('Z');
                }
            }
            svg.push('"');
            write_paint(svg, paint);
            svg.push_str("/>\n");
        }
        Item::Dots { points, diameter, color, opacity } => {
            svg.push_str("<path d=\"");
            for &(x, y) in points {
                // A line of no length with round ends: the shortest way to write a dot.
                let _ = write!(svg, "M{} {}h0", tenth(x), tenth(y));
            }
            let _ = write!(
                svg,
                "\" fill=\"none\" stroke-linecap=\"round\" stroke=\"{}\" stroke-width=\"{}\"",
                hex(*color),
                number(*diameter)
            );
            write_opacity(svg, *opacity);
            svg.push_str("/>\n");
        }
        Item::Text { at, text, size, anchor, turned, color } => {
            let _ = write!(svg, "<text x=\"{}\" y=\"{}\"", number(at.0), number(at.1));
            match anchor {
                Anchor::Start => {}
                Anchor::Middle => svg.push_str(" text-anchor=\"middle\""),
                Anchor::End => svg.push_str(" text-anchor=\"end\""),
            }
            if *turned {
                let _ = write!(svg, " transform=\"rotate(-90 {} {})\"", number(at.0), number(at.1));
            }
            // Another font in the font's place takes no more room than it.
            let _ = writeln!(
                svg,
                " font-size=\"{}\" textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\" fill=\"{}\">{}</text>",
                number(*size),
                number(font::width(text, *size)),
                hex(*color),
                escaped(text)
            );
        }
        Item::Group { class, title, clip, items } => {
            let _ = write!(svg, "<g class=\"{class}\">");
            if !title.is_empty() {
                let _ = write!(svg, "<title>{}</title>", escaped(title));
            }
            if let Some(Rect { x0, y0, x1, y1 }) = clip {
                let (width, height) = (number(x1 - x0), number(y1 - y0));
                let (x, y) = (number(*x0), number(*y0));
                let _ = write!(
                    svg,
                    "<svg x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" \
                     viewBox=\"{x} {y} {width} {height}\" overflow=\"hidden\">"
                );
            }
            svg.push('\n');
            items.iter().for_each(|item| write_item(svg, item));
            svg.push_str(if clip.is_some() { "</svg></g>\n" } else { "</g>\n" });
        }
    }
}

fn write_paint(svg: &mut String, paint: &Paint) {
    match paint.fill {
        Some(color) => {
            let _ = write!(svg, " fill=\"{}\"", hex(color));
        }
        None => svg.push_str(" fill=\"none\""),
    }
    if let Some((color, width)) = paint.stroke {
        let _ = write!(svg, " stroke=\"{}\" stroke-width=\"{}\"", hex(color), number(width));
        svg.push_str(" stroke-linejoin=\"round\"");
    }
    if let Some((on, off)) = paint.dash {
        let _ = write!(svg, " stroke-dasharray=\"{} {}\"", number(on), number(off));
    }
    write_opacity(svg, paint.opacity);
}

fn write_opacity(svg: &mut String, opacity: f64) {
    if opacity < 1.0 {
        let _ = write!(svg, " opacity=\"{}\"", number(opacity));
    }
}

fn write_point(svg: &mut String, (x, y): Point) {
    svg.push_str(&number(x));
    if y >= 0.0 {
        svg.push(' ');
    }
    svg.push_str(&number(y));
}

fn hex(Color(color): Color) -> String {
    format!("#{color:06x}")
}

/// A coordinate to a hundredth of a point, which no eye can tell.
fn number(value: f64) -> String {
    trimmed(format!("{value:.2}"))
}

fn tenth(value: f64) -> String {
    trimmed(format!("{value:.1}"))
}

fn trimmed(text: String) -> String {
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if matches!(short, "-0" | "") { "0".to_owned() } else { short.to_owned() }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_names_are_escaped() {
        assert_eq!([number(1.0), number(-0.001), number(10.5), number(100.0)], ["1", "0", "10.5", "100"]);
        assert_eq!(escaped("a<b & \"c\""), "a&lt;b &amp; &quot;c&quot;");
    }
}
