/** Ascending lists of numbers, each once: a varint each, relative to the least possible value. */

import { type Codec, Reader, WireError, Writer } from "trimaran-transport";

/** This many numbers always fit into an item. */
export const MOST_NUMBERS = 3_000;

/** These numbers sorted, without duplicates. */
export function numberList(numbers: Iterable<number>): Uint32Array<ArrayBuffer> {
  const sorted = Uint32Array.from(numbers).sort();
  return sorted.filter((number, at) => sorted[at - 1] !== number);
}

/** Splits a list into lists that fit into an item each. */
export function partNumbers(list: Uint32Array): Uint32Array[] {
  const parts: Uint32Array[] = [];
  for (let from = 0; from < list.length; from += MOST_NUMBERS) {
    parts.push(list.subarray(from, from + MOST_NUMBERS));
  }
  return parts;
}

export const NUMBERS: Codec<Uint32Array> = { read: readNumbers, write: writeNumbers };

function writeNumbers(writer: Writer, list: Uint32Array): void {
  const numbers = new Writer();
  let least = 0;
  for (const number of list) {
    numbers.varint(number - least);
    least = number + 1;
  }
  writer.byteString(numbers.take());
}

function readNumbers(reader: Reader): Uint32Array<ArrayBuffer> {
  const bytes = reader.byteString();
  const numbers = new Uint32Array(bytes.length);
  const varints = new Reader(bytes);
  let count = 0;
  for (let least = 0; !varints.isAtEnd; count += 1) {
    const number = least + varints.varint32();
    if (number > LARGEST) {
      throw new WireError("the numbers of a list go beyond 32 bits");
    }
    numbers[count] = number;
    least = number + 1;
  }
  return numbers.slice(0, count);
}

const LARGEST = 0xffff_ffff;
