// Prints the corrected rates of one device: device, sample number, time (s since 1970), x, y, z (rad/s).
//   g++ -O2 stream.cpp -o stream -lcurl && ./stream http://127.0.0.1:8090 chest 1000
// Debian: apt-get install g++ libcurl4-openssl-dev nlohmann-json3-dev. docs/stream.md explains the requests.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include <curl/curl.h>
#include <nlohmann/json.hpp>

static size_t keep(char *data, size_t, size_t n, void *text) {
  static_cast<std::string *>(text)->append(data, n);
  return n;
}

int main(int argc, char **argv) {
  if (argc < 3) return std::fprintf(stderr, "usage: stream URL DEVICE [SAMPLES]\n"), 2;
  long left = argc > 3 ? std::atol(argv[3]) : -1; // below 0: for ever
  std::string after; // where the next request resumes
  CURL *curl = curl_easy_init();
  while (left != 0) {
    const std::string url = std::string(argv[1]) + "/api/v1/stream?device=" + argv[2] + after;
    std::string text;
    long status = 503;
    curl_easy_setopt(curl, CURLOPT_URL, url.c_str());
    curl_easy_setopt(curl, CURLOPT_TIMEOUT, 30L); // an answer waits up to 10 s for a sample
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, keep);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, &text);
    if (curl_easy_perform(curl) == CURLE_OK) curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &status);
    if (status == 503) { // the dashboard is away or just starts
      std::this_thread::sleep_for(std::chrono::seconds(1));
      continue;
    }
    const auto said = nlohmann::json::parse(text);
    if (status != 200) return std::fprintf(stderr, "%s\n", said["error"]["message"].get<std::string>().c_str()), 1;
    for (const auto &one : said["documents"]) {
      const auto device = one["device"].get<std::string>();
      if (one["type"] == "missed") {
        std::fprintf(stderr, "%s: %s samples missed from number %s\n", device.c_str(), one["count"].dump().c_str(),
                     one["first"].dump().c_str());
        continue;
      }
      for (size_t i = 0; i < one["rate_rad_s"].size() && left != 0; ++i, --left) {
        const auto &rate = one["rate_rad_s"][i];
        std::printf("%s,%lld,%.6f,%.9g,%.9g,%.9g\n", device.c_str(), one["sequence"].get<long long>() + (long long)i,
                    one["time_s"][i].get<double>(), rate[0].get<double>(), rate[1].get<double>(), rate[2].get<double>());
      }
    }
    std::fflush(stdout);
    after.clear();
    for (const auto &place : said["after"]) after += "&after=" + place.get<std::string>();
  }
  curl_easy_cleanup(curl);
}
