/** All keys, by what they are for. The guide has the same list: a test compares them. */

import { type Row, Rows } from "../controls/rows.tsx";

/** Groups of keys, with the effects of each. */
export const KEYS: readonly (readonly [group: string, rows: readonly Row[]])[] = [
  [
    "Move",
    [
      ["W, A, S, D, arrows", "walk; the left and right arrow turn"],
      ["Shift", "four times as fast"],
      ["Space", "jump; up when flying"],
      ["E, Q or C", "up and down when flying"],
      ["wheel", "nearer, farther; in walk mode and with Shift, faster, slower"],
      ["right button or two fingers, dragged", "pan; in walk mode, move along the floor"],
      ["1, 2, 3", "walk on floors, fly through everything, orbit"],
      ["Alt+←, Alt+→", "back to the place before a jump, and forward"],
    ],
  ],
  [
    "Look",
    [
      ["drag with the mouse or a finger, Page Up, Page Down", "look around; in orbit, turn the model"],
      ["+, −", "field of view; in parallel, nearer or farther"],
      ["R", "parallel lines, for elevations at one scale; and back"],
      ["Home, Shift+F", "see all that is shown: from a corner, or from the present side"],
      ["4, 5, 6, 7, 8, 9, 0", "front, back, left, right, top, bottom, and from a corner"],
    ],
  ],
  [
    "Pick and hide",
    [
      ["click", "pick, at the chosen level; Escape picks nothing"],
      ["Ctrl+click, Shift+click", "pick one more; Ctrl+click on a picked one drops it"],
      ["Alt+click, U", "pick the group around what is picked; again, the next larger one"],
      ["K", "the next level of clicks"],
      ["F", "go to what is picked"],
      ["L", "show what is picked in the tree"],
      ["H, I, X", "hide it, isolate it, make it see-through"],
      ["G", "make all the rest ghosts; again, everything is solid"],
      ["Shift+H", "show everything again: nothing hidden, isolated, see-through or cut"],
      ["Ctrl+Z, Ctrl+Y", "undo, redo; also measurements"],
    ],
  ],
  [
    "Measure and cut",
    [
      ["M, B", "measures, sections"],
      ["Enter", "while measuring, take the point at the crosshair; close a polygon of clicked corners"],
      ["Escape, Backspace", "while measuring, take back the last point"],
    ],
  ],
  [
    "Panels",
    [
      ["T, Y, O, N", "the hierarchy as a tree, colours, clashes, notes"],
      ["V, P, J", "views, status, where you are"],
      ["Ctrl+P", "print the picture"],
      ["/", "search names and attributes"],
      ["?", "the list of keys in the page; again, and it closes"],
      ["Tab; Space, Enter, arrows", "go to the next button, list or tree; use it"],
      ["Escape", "back to the picture"],
    ],
  ],
];

export function KeyList() {
  return (
    <div>
      {KEYS.map(([group, rows]) => (
        <section key={group}>
          <h2>{group}</h2>
          <Rows rows={rows} />
        </section>
      ))}
    </div>
  );
}
