/**
 * What the browser keeps for the page. A browser may refuse to keep anything: then it is kept until
 * the page is left, for no button may fail by that.
 */

export const ofDevice = store(() => localStorage);
export const ofTab = store(() => sessionStorage);

function store(open) {
  const own = new Map(); // what was not taken

  return {
    get(key) {
      if (own.has(key)) return own.get(key);
      try {
        return open().getItem(key);
      } catch {
        return null;
      }
    },

    /** Keep a text; null is to keep nothing. */
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
