/** The rows of a long list that show, of which only these are elements. */

/** The greatest height of an element, CSS pixels: browsers draw none beyond some 33 million. */
const TALLEST = 16_000_000;
/** Rows beyond each end, so that scrolling shows no gap. */
const BEYOND = 8;

/** A list of `total` rows of one height, scrolled in an element of height `view`. CSS pixels. */
export interface RowList {
  readonly total: number;
  readonly row: number;
  readonly view: number;
}

/** The height of the element that is scrolled. */
export function heightOf({ total, row }: RowList): number {
  return Math.min(total * row, TALLEST);
}

/** How much the list moves for a pixel of scrolling: 1, unless it is taller than an element can be. */
function ratioOf(list: RowList): number {
  const [full, height] = [list.total * list.row, heightOf(list)];
  return full > height && height > list.view ? (full - list.view) / (height - list.view) : 1;
}

/** The rows to draw at a scroll position: from `first` to before `end`. The first one stands at `top`. */
export function rowsAt(list: RowList, scrolled: number): { first: number; end: number; top: number } {
  const offset = scrolled * ratioOf(list);
  const first = Math.max(0, Math.floor(offset / list.row) - BEYOND);
  const end = Math.min(list.total, Math.ceil((offset + list.view) / list.row) + BEYOND);
  return { first, end, top: first * list.row - offset + scrolled };
}

/** The nearest scroll position at which a row shows wholly. */
export function scrolledTo(list: RowList, index: number, scrolled: number): number {
  const ratio = ratioOf(list);
  const offset = scrolled * ratio;
  const [top, bottom] = [index * list.row, (index + 1) * list.row];
  const next = top < offset ? top : bottom > offset + list.view ? bottom - list.view : offset;
  return next === offset ? scrolled : next / ratio;
}
