/** Errors (section 1). Each message is a sentence for a person. */

/** A failure of the film, the network, or the browser. */
export class GsvrError extends Error {
  name = "GsvrError";
  /** Whether `Film.open` with `keepGoing` may find GOPs. */
  recoverable = false;
}

/** The film breaks a rule. */
export class CorruptError extends GsvrError {
  name = "CorruptError";
}

/** The film needs a feature or a size that is not there. */
export class UnsupportedError extends GsvrError {
  name = "UnsupportedError";
}

/** Report a broken rule. */
export function check(condition, message) {
  if (!condition) throw new CorruptError(message);
}

/** Put the place of an error before its sentence. */
export function located(error, place) {
  if (error instanceof GsvrError) {
    error.message = `${place}: ${error.message[0].toLowerCase()}${error.message.slice(1)}`;
  }
  return error;
}

/** Whether an error is of the film. */
export function isFault(error) {
  return error instanceof CorruptError || error instanceof UnsupportedError;
}

/** Return what a promise gives, or its CorruptError. */
export async function orFault(promise) {
  try {
    return await promise;
  } catch (error) {
    if (error instanceof CorruptError) return error;
    throw error;
  }
}
