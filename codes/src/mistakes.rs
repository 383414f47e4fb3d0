//! Mistakes of the input that a fit recognises.

codes! {
    COMMANDS = 401: "columns of commands are exchanged";
    COMMAND_SIGN = 402: "a command counts the other way";
    COMMAND_ZERO = 403: "a command counts from another zero";
    ROWS = 404: "measured rows are shifted against those of the commands";
    HEIGHT_SIGN = 405: "heights count the other way";
    AXES = 406: "axes of positions are exchanged";
    ANGLES = 407: "angles follow another convention";
    FRAME = 408: "poses are those of another frame than the drawing's";
    MILLIMETRES = 409: "lengths are in millimetres";
    CENTIMETRES = 410: "lengths are in centimetres";
    INCHES = 411: "lengths are in inches";
    DEGREES = 412: "angles are in degrees";
    NOISE = 413: "stated noise is a thousand times off";
    TOLERANCES = 414: "tolerances are a thousand times off";
    DIMENSION = 415: "a dimension is far off";
    CARTS = 416: "carts are numbered otherwise";
    DISTANCES = 417: "distances are exchanged";
    MIRRORED = 418: "an axis of positions is mirrored";
    ANGLE_SIGN = 419: "an angle counts the other way";
    INCHES_FOR_MILLIMETRES = 420: "lengths are in inches that were taken for millimetres";
    POSE_NUMBERS = 421: "rows name other poses than they measured";
}
