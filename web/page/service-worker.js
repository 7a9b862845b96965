// Keeps the page's files, so that it works without a network once loaded. The build writes VERSION and FILES.
const VERSION = "@VERSION@";
const FILES = "@FILES@".split(" ");

self.addEventListener("install", (installed) => {
  installed.waitUntil(caches.open(VERSION).then((cache) => cache.addAll(FILES)).then(() => self.skipWaiting()));
});
self.addEventListener("activate", (active) => {
  const old = (names) => names.filter((name) => name !== VERSION).map((name) => caches.delete(name));
  active.waitUntil(caches.keys().then((names) => Promise.all(old(names))).then(() => self.clients.claim()));
});
self.addEventListener("fetch", (fetched) => {
  if (new URL(fetched.request.url).origin !== self.location.origin) return;
  fetched.respondWith(caches.match(fetched.request, { ignoreSearch: true }).then((kept) => kept ?? fetch(fetched.request)));
});
