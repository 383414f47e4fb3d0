//! Origin of the report: program, day, split, files.

use maud::{Markup, html};
use tau::session::Record;
use tau::study::results::Setting;

/// The record.
pub(super) fn table(record: &Record, Setting { poses, rows, .. }: &Setting) -> Markup {
    html! {
        div.record {
            h2.small { "Record" }
            dl {
                div { dt { "Written by" } dd { (record.stamp.program) ", " time datetime=(record.stamp.date) { (record.stamp.date) } } }
                div {
                    dt { "Split" }
                    dd {
                        code { (record.split) }
                        @if let Some(rows) = rows {
                            ": rows of " (rows.calibration.len()) " poses calibrate"
                            @if !rows.is_disjoint() {
                                ", none are held out"
                            } @else {
                                ", of " (rows.validation.len()) " validate"
                            }
                            @if !rows.distances.is_empty() && rows.is_disjoint() {
                                "; " (rows.distances.len()) " distances calibrate, " (rows.held_out_distances.len()) " validate"
                            }
                        } @else {
                            ": " (poses.calibration) " poses calibrate, " (match poses.validation { 0 => "none are held out".to_owned(), count => format!("{count} validate") })
                        }
                    }
                }
                @for input in &record.inputs {
                    div { dt { (input.name) } dd { span.sum { (input.sha256) } } }
                }
            }
            @if !record.inputs.is_empty() { p.note { "Checksums are SHA-256." } }
        }
    }
}
