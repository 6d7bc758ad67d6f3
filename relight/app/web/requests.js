// Requests to the server. Addresses are relative: the page's own address holds the token.

/** Something that cannot be done, in the server's sentence. */
export class Refused extends Error {}

const GONE = "The server does not answer: start relight app again, and open the address that it prints.";

/**
 * A response, or Refused.
 * @param {string} path
 * @param {{ body?: any, method?: string, signal?: AbortSignal }} options
 */
export async function ask(path, { body, method = body === undefined ? "GET" : "POST", signal } = {}) {
  let response;
  try {
    response = await fetch(path, { method, body, signal, referrerPolicy: "no-referrer" });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused(GONE);
  }
  if (response.ok) return response;
  const answer = await response.json().catch(() => ({}));
  throw new Refused(answer.sentence ?? `The server refused the request (${response.status}).`);
}

export const askJson = async (path, options) => (await ask(path, options)).json();
export const post = (path, value, signal) => ask(path, { body: JSON.stringify(value), signal });

/** What the server warned of, in the header of a response. */
export const notesOf = (response) => JSON.parse(decodeURIComponent(response.headers.get("X-Notes") ?? "%5B%5D"));

/** A task whose progress is told in lines: what it comes to. */
export async function follow(path, value, onprogress, signal) {
  const response = await post(path, value, signal);
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { done, value: part } = await reader.read().catch((error) => {
      if (error.name === "AbortError") throw error;
      throw new Refused(GONE);
    });
    text += part ?? "";
    const lines = text.split("\n");
    text = lines.pop();
    for (const line of lines) {
      const said = JSON.parse(line);
      if (said.sentence) throw new Refused(said.sentence);
      if (said.done) return said.done;
      onprogress(said.progress.what, said.progress.share);
    }
    if (done) throw new Refused(GONE);
  }
}

/** The address of a photograph's reduced copy; another one when it has been turned. */
export const previewOf = ({ id, turns }) => `photographs/${id}/preview?turns=${turns}`;
