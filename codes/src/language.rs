//! Descriptions of robots and effects.

codes! {
    SYNTAX = 101: "a description is not written as the grammar says";
}
