/**
 * Values that the browser stores for the page. If a browser refuses to store anything, the values
 * are kept until the page is left, so that no button fails because of this.
 */

export const ofDevice = store(() => localStorage);
export const ofTab = store(() => sessionStorage);

function store(open) {
  const own = new Map(); // values that the browser did not store

  return {
    get(key) {
      if (own.has(key)) return own.get(key);
      try {
        return open().getItem(key);
      } catch {
        return null;
      }
    },

    /** Store a text; null removes it. */
    set(key, text) {
      own.delete(key);
      try {
        if (text === null) open().removeItem(key);
        else open().setItem(key, text);
      } catch {
        own.set(key, text);
      }
    },
  };
}
