/** Whether what has the keyboard takes keys itself, and so shortcuts are not meant. */
export function isTyping(target: EventTarget | null): boolean {
  const takesKeys = "input:not([type=checkbox], [type=file]), select, textarea";
  return target instanceof HTMLElement && target.closest(takesKeys) !== null;
}
