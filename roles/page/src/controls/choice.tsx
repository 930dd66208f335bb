/** A choice of one among several options. */

/** An option to choose. */
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
  return (
    <label>
      {label}{" "}
      <select
        value={options.findIndex((option) => option.value === value)}
        onChange={(event) => {
          const chosen = options[Number(event.currentTarget.value)];
          if (chosen !== undefined) {
            onChoose(chosen.value);
          }
        }}
      >
        {options.map(({ text, title }, at) => (
          <option key={text} value={at} title={title}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
}
