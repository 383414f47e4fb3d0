//! Files, options and arguments.

codes! {
    // Reading any file.
    NO_SUCH_FILE = 201: "a file does not exist";
    IS_FOLDER = 202: "there is a folder where a file is expected";
    NO_SUCH_FOLDER = 203: "a folder does not exist";
    IS_FILE = 204: "there is a file where a folder is expected";
    CANNOT_READ = 205: "a file or folder cannot be opened or read";
    NOT_UTF8 = 206: "a text is not UTF-8";

    // Tables.
    EMPTY_TABLE = 210: "a table has no header or no rows";
    SEPARATOR = 211: "columns are not separated by commas";
    NO_HEADER = 212: "the first line of a table holds numbers in place of names";
    RAGGED_ROW = 213: "a row has more or fewer fields than the header";
    COLUMN_MISSING = 214: "a column is missing";
    COLUMN_TWICE = 215: "two columns have the same name";
    COLUMN_UNIT = 216: "the name of a column has another unit than the expected one";
    NOT_A_NUMBER = 217: "a field holds no finite number";
    NOT_WHOLE = 218: "a field holds no whole number from 0";
    UNKNOWN_NOISE_COLUMN = 219: "a column states the noise of a quantity that the file does not hold";
    NOTHING_MEASURED = 220: "a row or a table holds no measurement";
    NOT_METRES = 221: "a length is too large for metres";
    NOT_RADIANS = 222: "an angle is too large for radians";
    OUT_OF_BOUNDS = 223: "a number lies outside the bounds of its quantity";
    FAR_FROM_OTHERS = 224: "a number is far from those of the other rows";
    NO_SUCH_CART = 225: "the robot has no cart of this number";
    ROW_TWICE = 226: "two rows have the same number";
    NO_SPREAD = 227: "all rows of a table have the same values";
    OTHER_COMMANDS = 228: "a pose has other commands in another file";
    UNKNOWN_POSE = 229: "a distance is from a pose that no other file holds, or from a pose to itself";
    MISNAMED_TABLE = 230: "a table of measurements has a name that is not read";
    SET_MISSING = 231: "set 2 or set 3 is missing";
    COLUMNS_IGNORED = 232: "unknown columns are ignored";
    COLUMNS_ABSENT = 233: "optional columns are missing";
    MOTIONS_IGNORED = 234: "columns measure motions that the plate lacks, and are ignored";
    CART_UNMEASURED = 235: "set 2 has no points of a cart";

    // `robot.toml`.
    TOML = 240: "a file is not written as TOML";
    KEY_TWICE = 241: "a key is given twice";
    KEY_MISSING = 242: "a key or a section is missing";
    UNKNOWN_KEY = 243: "a key is unknown";
    WRONG_TYPE = 244: "a value has the wrong type";
    PLACEHOLDER = 245: "a value is still the placeholder of a template";
    COUNT = 246: "there are more or fewer numbers than expected";
    ORDER = 247: "numbers are not in ascending order";
    UNKNOWN_NAME = 248: "a name is none of the robot or of its file";
    EFFECT_KEY = 249: "an effect is not written with its name and place";
    NOT_PULLED = 250: "a tension is given for a link without one to calibrate";
    IDLE_MOTION = 251: "a pose has a motion that the plate lacks";
    FORMULA_VALUE = 252: "a formula has no finite value at the values given";
    OTHER_ROBOT = 253: "a file is for another robot";
    OTHER_DESCRIPTION = 254: "a file was calibrated with another description or variant";
    UNUSED_VALUES = 255: "values of a file are not used";
    NO_ESTIMATE = 256: "noise is to be estimated where only a number is possible";
    NO_TRAVEL = 257: "an effect reads the travel of the drives, and nothing states it";
    BEYOND_TRAVEL = 258: "commands lie outside the stated travel of a drive";

    // Options and arguments.
    USAGE = 260: "the command line is not written as the command expects";
    OPTION_VALUE = 261: "an option has a value that it cannot take";
    OPTION_WITHOUT_USE = 262: "an option has no use here";
    NO_SUCH_VARIANT = 263: "a variant does not exist";
    NO_SUCH_ROBOT = 264: "there is no built-in robot of this name";
    NO_FOLDER = 265: "no measurement folder is named";

    // Files of firmware.
    FIRMWARE_SYNTAX = 270: "a line of a firmware file is not written as the firmware expects";
    SAVED_BLOCK = 271: "the saved block of a firmware file cannot be read";
    INCLUDE_LOOP = 272: "a firmware file includes itself";
    INCLUDE_UNREAD = 273: "a file is included but not read, or named but not included";
    FIRMWARE_OPTION_MISSING = 274: "an option of a firmware file is missing";
    FIRMWARE_OPTION_VALUE = 275: "an option of a firmware file has a value that it cannot take";
    FIRMWARE_REFUSES = 276: "the firmware refuses the parameters of the printer";
    FIRMWARE_CONTRADICTION = 277: "measurements of a firmware file contradict its parameters";
    FIRMWARE_UNMEASURED = 278: "measurements of a firmware file are missing or not read";
    FIRMWARE_DIFFERS = 279: "distance of the machine that a firmware has from the calibrated one";

    // Output files.
    CANNOT_WRITE = 280: "a file or folder cannot be written";
    ALREADY_THERE = 281: "an output would replace something that is there already";
    REPLACES_INPUT = 282: "an output would replace an input, or another output";
    STALE = 283: "generated code is not up to date";

    // Requests of simulations.
    EFFECT_SYNTAX = 290: "an effect of a simulation is not written with its place and parameters";
    NO_SUCH_EFFECT = 291: "the simulation has no effect of this name";
    EFFECT_PLACE = 292: "an effect of a simulation cannot act at a place";
    EFFECT_PARAMETER = 293: "a parameter of a simulated effect is missing, unknown or without use";
    UNKNOWN_VALUES = 294: "the virtual robot lacks values";
    NO_FORCES = 295: "a simulation needs forces, and none act";
    SAYS_NOTHING = 296: "a part of a simulation has no influence on the measurements";
    LEFT_OUT = 297: "a part of a simulation is left out";
}
