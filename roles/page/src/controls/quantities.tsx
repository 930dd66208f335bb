/** A text with quantities, of which no line parts a number from its unit. */

export function Quantities({ text }: { readonly text: string }) {
  return (
    <>
      {unbroken(text).map((piece, at) => (
        <>
          {at > 0 && " "}
          <span class="unbroken">{piece}</span>
        </>
      ))}
    </>
  );
}

/** The pieces of a text between which a line may break: after a comma, a sign of times, or “to”. */
export function unbroken(text: string): readonly string[] {
  return text.replaceAll(/(,|×|\bto) /g, "$1\n").split("\n");
}
