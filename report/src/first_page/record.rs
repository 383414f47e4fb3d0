//! Origin of the report: program, day, split, files.

use maud::{Markup, html};
use tau::measurements::PoseCounts;
use tau::session::Record;

/// The record.
pub(super) fn table(record: &Record, poses: Option<PoseCounts>) -> Markup {
    html! {
        div.record {
            h2.small { "Record" }
            dl {
                div { dt { "Written by" } dd { (record.stamp.program) ", " time datetime=(record.stamp.date) { (record.stamp.date) } } }
                div {
                    dt { "Split" }
                    dd {
                        code { (record.split) }
                        @if let Some(poses) = poses { ": " (poses.calibration) " poses calibrate, " (poses.validation) " validate" }
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
