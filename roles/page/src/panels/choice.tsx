/** One of several, to choose. */

/** Something to choose. */
export interface Option<T> {
  readonly value: T;
  readonly text: string;
  readonly title?: string;
}

export function Choice<T>({
  label,
  options,
  value,
  onChoose,
}: {
  readonly label: string;
  readonly options: readonly Option<T>[];
  readonly value: T;
  readonly onChoose: (value: T) => void;
}) {
  const known = options.some((option) => option.value === value);
  // What was set elsewhere is shown as well.
  const all = known ? options : [...options, { value, text: String(value) }];
  return (
    <label>
      {label}{" "}
      <select
        value={all.findIndex((option) => option.value === value)}
        onChange={(event) => {
          const chosen = all[Number(event.currentTarget.value)];
          if (chosen !== undefined) {
            onChoose(chosen.value);
          }
          // The keys walk on.
          event.currentTarget.blur();
        }}
      >
        {all.map(({ text, title }, at) => (
          <option key={text} value={at} title={title}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
}
