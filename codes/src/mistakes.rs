//! Mistakes of the input that a fit recognises.

codes! {
    COMMANDS = 401: "columns of commands are exchanged";
}
