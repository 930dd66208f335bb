/** A table of names and values. */

import type { ComponentChildren } from "preact";

export type Row = readonly [name: string, value: ComponentChildren];

export function Rows({ rows }: { readonly rows: readonly Row[] }) {
  return (
    <table>
      <tbody>
        {rows.map(([name, value]) => (
          <tr key={name}>
            <th scope="row">{name}</th>
            <td>{value}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
