/** Error messages for a person. */

/** The message of an error, without secrets. */
export function messageOf(error: unknown): string {
  return withoutSecrets(error instanceof Error ? error.message : String(error));
}

/**
 * Cuts addresses in a text before their query, where the token is. Every text that the page shows of errors
 * and events passes here.
 */
export function withoutSecrets(text: string): string {
  return text
    .replace(/\b([a-z][a-z0-9+.-]*:\/\/[^\s?#"'<>]*)[?#][^\s"'<>]*/gi, "$1")
    .replace(/\btoken=[^\s&"'<>]*/gi, "token=…");
}
