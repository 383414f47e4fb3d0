//! Files, options and arguments.

codes! {
    NO_SUCH_FILE = 201: "a file does not exist";
}
