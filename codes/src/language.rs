//! Descriptions of robots and effects.

codes! {
    // Characters and brackets.
    UNPAIRED_BRACKET = 101: "a bracket has no partner, or closes another one";
    UNCLOSED_COMMENT = 102: "a comment is never closed";
    UNKNOWN_CHARACTER = 103: "a character has no meaning in a description";
    HASH_COMMENT = 104: "a comment begins with `#` instead of `//`";
    PLUS_MINUS = 105: "a tolerance is written with a sign instead of `tol`";
    TOO_DEEP = 106: "brackets or a formula are nested too deeply";
    ATTRIBUTE = 107: "an attribute stands before a declaration";
    RUST_CODE = 108: "Rust code stands in a description";

    // Grammar.
    NO_ROBOT = 109: "a description holds no robot";
    SECOND_ROBOT = 110: "a description holds a second robot";
    UNKNOWN_WORD = 111: "a word is none of those that may stand there";
    SYNTAX = 112: "a word or a sign of the grammar is missing";
    MISSING_SEMICOLON = 113: "a declaration does not end with `;`";
    MISSING_NAME = 114: "a name is missing";
    MISSING_VALUE = 115: "a value is missing in a formula";
    MISSING_SEPARATOR = 116: "two values or names stand side by side without an operator or a comma";

    // Numbers and operators as they are written.
    MISSING_NUMBER = 117: "a number is missing, or is no whole one where it must be";
    NOT_DECIMAL = 118: "a number is not decimal";
    DECIMAL_COMMA = 119: "a number has a decimal comma";
    UNIT_WITHOUT_SPACE = 120: "no space stands between a number and its unit";
    PERCENT_SIGN = 121: "a percentage is written with a sign instead of `percent`";
    NUMBER_TOO_LARGE = 122: "a number is larger than numbers can be";
    EXPONENT = 123: "an exponent is no whole number, or is too large";
    OPERATORS = 124: "operators follow each other that cannot, or are those of another language";
    DOT = 125: "a dot stands behind a name in a formula";

    // Names.
    RESERVED_NAME = 126: "a name is a keyword or has letters outside ASCII";
    NAME_WITH_MEANING = 127: "the name of a parameter has a meaning in formulas";
    DECLARED_TWICE = 128: "a name is declared twice";
    NAMES_CLASH_IN_CODE = 129: "two names would be one name of generated code";
    LOWER_CASE_ROBOT = 130: "the name of a robot begins with no capital letter";
    UNKNOWN_TRACK = 131: "no track has this name";
    UNKNOWN_LINK = 132: "no link has this name";
    UNKNOWN_EFFECT = 133: "no effect has this name";
    UNKNOWN_VARIANT = 134: "no variant has this name";
    UNKNOWN_PARAMETER = 135: "no parameter has this name";
    UNKNOWN_NAME = 136: "a name in a formula has no meaning there";
    UNKNOWN_FUNCTION = 137: "no function has this name";
    UNKNOWN_UNIT = 138: "no unit or dimension has this name";
    UNKNOWN_TARGET = 139: "an effect adds to something that does not exist";
    UNKNOWN_SUBJECT = 140: "an effect acts on something that does not exist";
    UNKNOWN_VALUE = 141: "a link or a crank has no value of this name";
    SAID_TWICE = 142: "something is said twice that may be said once";

    // Units, shapes and sizes.
    WRONG_DIMENSION = 143: "a value or a formula has another dimension than what it is for";
    DIFFERENT_DIMENSIONS = 144: "values of different dimensions are added, compared or put into one vector";
    ARGUMENT_DIMENSION = 145: "a function does not take a value of this dimension";
    UNIT_OVERFLOW = 146: "the exponents of a unit are too large";
    WRONG_SHAPE = 147: "a vector stands for a scalar, or a scalar for a vector";
    VECTOR_OPERATION = 148: "an operation does not exist for vectors";
    VECTOR_COMPONENTS = 149: "a vector does not have 3 components";
    NO_COMPONENT = 150: "a value has no such component";
    ARGUMENT_COUNT = 151: "a function takes another number of arguments";
    PRODUCT_WITHOUT_STAR = 152: "a product is written without `*`";
    NOT_FINITE = 153: "a formula has no finite value";
    NOT_POSITIVE = 154: "a value or a tolerance must be greater than zero";
    TOLERANCE_OUT_OF_RANGE = 155: "a tolerance is too small or too large to mean anything";
    LENGTH_OUT_OF_RANGE = 156: "no machine has a length of this size";
    ANGLE_OUT_OF_RANGE = 157: "an angle is larger than one turn";

    // Effects.
    NO_TERMS = 158: "an effect adds to nothing";
    UNUSED_PARAMETER = 159: "no formula reads a parameter";
    SEARCH = 160: "a parameter cannot be searched like this";
    SEARCH_RANGE = 161: "a search range is empty or does not begin above zero";
    SUBJECT = 162: "the subject of an effect has no such kind or source";
    TARGET_OF_OTHER = 163: "an effect adds to something that its subject does not have";
    UNREADABLE_IN_EFFECT = 164: "an effect cannot read this quantity";

    // Robots.
    UNREADABLE_IN_VALUE = 165: "a value of the geometry cannot read this name";
    VALUE_NOT_HERE = 166: "a link does not have this value where it stands";
    CERTAINTY = 167: "`exact` or `tol` does not fit what it stands behind";
    CONSTANT_FORMULA = 168: "a formula reads no parameters and is not exact";
    VALUES_IN_CIRCLE = 169: "values read each other in a circle";
    NO_DIRECTION = 170: "a direction or an axis is zero or moves no plate in its plane";
    DRIVEN_TWICE = 171: "a link is driven by its cart already";
    COMMAND_UNREAD = 172: "the length of a driven link does not follow from its command";
    PULLED = 173: "a link cannot be pulled like this";
    PARTS_MISSING = 174: "a robot lacks tracks, clusters, links or variants";
    TRACK_CARRIES_NOTHING = 175: "a track or a crank carries no cluster";
    TOO_MANY_PARTS = 176: "a robot has too many parts";
    NOTHING_MOVES = 177: "nothing of a robot is driven";
    CANNOT_MOVE = 178: "links take all freedoms of the plate";
    OVER_CONSTRAINED = 179: "links take more freedoms than the plate has";
    LOOSE = 180: "too few links hold the plate";
    REFERENCE_INCOMPLETE = 181: "a reference lacks its position, or has another number of commands or angles";
    REFERENCE_UNFIT = 182: "a reference does not fit the plate or the drives";

    // Variants.
    VARIANT_INCOMPLETE = 183: "a variant lacks its arm or the model of a track";
    NO_TRACK_HERE = 184: "a variant gives a model to something that is no track";
    REDUCED_ARM = 185: "a robot or a variant cannot have a reduced arm";
    NEEDS_FULL_ARM = 186: "an effect needs a full arm";
    VARIANT_CIRCLE = 187: "a variant refers to itself";
    CANNOT_HOLD = 188: "a variant cannot hold this";
    PLACE_COUNT = 189: "an effect takes another number of places, or different ones";
    PLACE_OF_OTHER_KIND = 190: "an effect does not act on this kind of place";
    COMMAND_NOT_THERE = 191: "an effect reads a command that is not there, or is an angle";
    WITH = 192: "a use names something that is no optional parameter";
    PLACE_AMBIGUOUS = 193: "a place may be of several effects of one name";
}
